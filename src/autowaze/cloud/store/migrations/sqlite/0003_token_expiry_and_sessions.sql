ALTER TABLE tokens ADD COLUMN expires_at REAL;
ALTER TABLE tokens ADD COLUMN old_hash BLOB;
ALTER TABLE tokens ADD COLUMN old_until REAL;
CREATE INDEX tokens_by_old_hash ON tokens (old_hash);
CREATE TABLE source_keys (
    day INTEGER PRIMARY KEY,
    secret BLOB NOT NULL
);
CREATE TABLE sessions (
    session INTEGER PRIMARY KEY,
    source INTEGER NOT NULL,
    day INTEGER NOT NULL
);
