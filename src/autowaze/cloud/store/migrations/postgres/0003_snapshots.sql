CREATE TABLE snapshots (
    position BIGINT PRIMARY KEY,
    made_at DOUBLE PRECISION NOT NULL,
    sha256 BYTEA NOT NULL
);
CREATE TABLE snapshot_parts (
    position BIGINT NOT NULL,
    part INTEGER NOT NULL,
    data BYTEA NOT NULL,
    PRIMARY KEY (position, part)
);
CREATE INDEX diffs_by_time ON diffs (received_at);
CREATE INDEX audit_by_time ON audit (at);
