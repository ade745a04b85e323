CREATE TABLE IF NOT EXISTS tokens (
    hash BLOB PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    scopes TEXT NOT NULL,
    created_at REAL NOT NULL,
    revoked_at REAL
) WITHOUT ROWID;
CREATE TABLE spot_names (
    spot INTEGER PRIMARY KEY,
    spot_id TEXT NOT NULL UNIQUE
);
CREATE TABLE history (
    number INTEGER PRIMARY KEY,
    received_at REAL NOT NULL,
    spot INTEGER NOT NULL,
    occupancy TEXT NOT NULL,
    probability_vacant REAL NOT NULL,
    observed_at REAL
);
CREATE INDEX history_by_time ON history (received_at);
CREATE INDEX history_by_spot ON history (spot, received_at);
CREATE TABLE audit (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    at REAL NOT NULL,
    actor TEXT NOT NULL,
    action TEXT NOT NULL,
    detail TEXT NOT NULL
);
CREATE TABLE parking_maps (
    version INTEGER PRIMARY KEY AUTOINCREMENT,
    saved_at REAL NOT NULL,
    actor TEXT NOT NULL,
    geojson BLOB NOT NULL
);
