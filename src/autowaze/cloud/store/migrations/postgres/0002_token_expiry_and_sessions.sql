ALTER TABLE tokens ADD COLUMN expires_at DOUBLE PRECISION;
ALTER TABLE tokens ADD COLUMN old_hash BYTEA;
ALTER TABLE tokens ADD COLUMN old_until DOUBLE PRECISION;
CREATE INDEX tokens_by_old_hash ON tokens (old_hash);
CREATE TABLE source_keys (
    day INTEGER PRIMARY KEY,
    secret BYTEA NOT NULL
);
CREATE TABLE sessions (
    session BIGINT PRIMARY KEY,
    source BIGINT NOT NULL,
    day INTEGER NOT NULL
);
