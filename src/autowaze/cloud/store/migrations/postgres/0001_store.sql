CREATE TABLE diffs (
    position BIGINT PRIMARY KEY,
    session BIGINT NOT NULL,
    sequence INTEGER NOT NULL,
    received_at DOUBLE PRECISION NOT NULL,
    payload BYTEA NOT NULL,
    UNIQUE (session, sequence)
);
-- Payloads are compressed already.
ALTER TABLE diffs ALTER COLUMN payload SET STORAGE EXTERNAL;
CREATE TABLE spots (
    spot_id TEXT PRIMARY KEY,
    occupancy TEXT NOT NULL,
    probability_vacant DOUBLE PRECISION NOT NULL,
    observed_at DOUBLE PRECISION,
    evidence TEXT NOT NULL
) WITH (fillfactor = 50);
CREATE TABLE spot_names (
    spot INTEGER PRIMARY KEY,
    spot_id TEXT NOT NULL UNIQUE
);
CREATE TABLE history (
    number BIGINT PRIMARY KEY,
    received_at DOUBLE PRECISION NOT NULL,
    spot INTEGER NOT NULL,
    occupancy TEXT NOT NULL,
    probability_vacant DOUBLE PRECISION NOT NULL,
    observed_at DOUBLE PRECISION
);
CREATE INDEX history_by_time ON history (received_at);
CREATE INDEX history_by_spot ON history (spot, received_at, number);
CREATE TABLE audit (
    number BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    at DOUBLE PRECISION NOT NULL,
    actor TEXT NOT NULL,
    action TEXT NOT NULL,
    detail TEXT NOT NULL
);
CREATE TABLE parking_maps (
    version INTEGER GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    saved_at DOUBLE PRECISION NOT NULL,
    actor TEXT NOT NULL,
    geojson BYTEA NOT NULL
);
CREATE TABLE tokens (
    hash BYTEA PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    scopes TEXT NOT NULL,
    created_at DOUBLE PRECISION NOT NULL,
    revoked_at DOUBLE PRECISION
);
CREATE TABLE spot_outlines (
    spot_id TEXT PRIMARY KEY,
    kind TEXT NOT NULL,
    outline geometry(Polygon, 4326) NOT NULL
);
CREATE INDEX spot_outlines_by_place ON spot_outlines USING gist (outline);
-- For GIS tools: every spot of the parking map with what is believed of it.
CREATE VIEW parking_spots AS
    SELECT
        spot_id,
        kind,
        coalesce(occupancy, 'unknown') AS state,
        coalesce(probability_vacant, 0.5) AS probability_vacant,
        to_timestamp(observed_at) AS observed_at,
        evidence,
        outline
    FROM spot_outlines
    LEFT JOIN spots USING (spot_id);
