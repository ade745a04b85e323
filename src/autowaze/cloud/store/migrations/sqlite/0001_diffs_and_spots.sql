CREATE TABLE diffs (
    position INTEGER PRIMARY KEY,
    session INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    received_at REAL NOT NULL,
    payload BLOB NOT NULL,
    UNIQUE (session, sequence)
);
CREATE TABLE spots (
    spot_id TEXT PRIMARY KEY,
    occupancy TEXT NOT NULL,
    probability_vacant REAL NOT NULL,
    observed_at REAL,
    evidence TEXT NOT NULL
) WITHOUT ROWID;
