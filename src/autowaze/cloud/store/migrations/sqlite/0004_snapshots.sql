CREATE TABLE snapshots (
    position INTEGER PRIMARY KEY,
    made_at REAL NOT NULL,
    sha256 BLOB NOT NULL
);
CREATE TABLE snapshot_parts (
    position INTEGER NOT NULL,
    part INTEGER NOT NULL,
    data BLOB NOT NULL,
    PRIMARY KEY (position, part)
);
CREATE INDEX diffs_by_time ON diffs (received_at);
CREATE INDEX audit_by_time ON audit (at);
