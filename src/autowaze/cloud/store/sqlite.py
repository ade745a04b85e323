"""A store in one SQLite file with a write-ahead log: needs nothing installed, survives kill -9 and power cuts."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from autowaze.cloud.store.store import Accepted, StoreError
from autowaze.world.parking import Occupancy, SpotState

SCHEMA_VERSION = 1
_SCHEMA = """
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
"""
_ROWS_AT_ONCE = 256


class SqliteStore:
    """A `Store` in one file. One process writes it; others may read."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self._connection = sqlite3.connect(self.path, isolation_level=None, check_same_thread=False, timeout=5.0)
            self._prepare()
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: cannot be opened as a store: {error}") from error
        self._position = self._last_position()

    @property
    def position(self) -> int:
        """Number of the last diff that this process knows of."""
        return self._position

    def log(self, after: int = 0) -> Iterator[Accepted]:
        """Diffs after a position, in order."""
        query = "SELECT position, session, sequence, received_at, payload FROM diffs WHERE position > ? "
        while rows := self._connection.execute(f"{query} ORDER BY position LIMIT {_ROWS_AT_ONCE}", (after,)).fetchall():
            for position, *accepted in rows:
                after = position
                yield Accepted(*accepted)

    def commit(self, accepted: Iterable[Accepted], changed: Iterable[SpotState]) -> int:
        """Append diffs and changed states in one transaction; raises `StoreError`, and then nothing was kept.

        The position is counted here, not by the database: if another process had written in between, the numbers
        would clash and the transaction fail, instead of two services overwriting each other's state.
        """
        numbered = [
            (position, a.session, a.sequence, a.received_at, a.payload)
            for position, a in enumerate(accepted, start=self._position + 1)
        ]
        with self._transaction():
            self._connection.executemany("INSERT INTO diffs VALUES (?, ?, ?, ?, ?)", numbered)
            self._upsert(changed)
        self._position += len(numbered)
        return self._position

    def replace_spots(self, states: Iterable[SpotState]) -> None:
        """Put these states in place of all that are kept."""
        with self._transaction():
            self._connection.execute("DELETE FROM spots")
            self._upsert(states)

    def spots(self) -> list[SpotState]:
        """The states kept, in no order."""
        rows = self._connection.execute(
            "SELECT spot_id, occupancy, probability_vacant, observed_at, evidence FROM spots"
        )
        return [SpotState(spot_id, Occupancy(occupancy), *rest) for spot_id, occupancy, *rest in rows]

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()

    def _prepare(self) -> None:
        self._connection.execute("PRAGMA journal_mode = WAL")
        self._connection.execute("PRAGMA synchronous = FULL")  # WAL with NORMAL may lose commits in a power cut
        version = self._connection.execute("PRAGMA user_version").fetchone()[0]
        if version == 0:
            self._connection.executescript(f"BEGIN;{_SCHEMA}PRAGMA user_version = {SCHEMA_VERSION};COMMIT;")
        elif version != SCHEMA_VERSION:
            raise StoreError(f"{self.path}: store of version {version}, this program knows {SCHEMA_VERSION}")

    def _last_position(self) -> int:
        return int(self._connection.execute("SELECT coalesce(max(position), 0) FROM diffs").fetchone()[0])

    def _upsert(self, states: Iterable[SpotState]) -> None:
        rows = [(s.spot_id, s.occupancy.value, s.probability_vacant, s.observed_at, s.evidence) for s in states]
        self._connection.executemany("INSERT OR REPLACE INTO spots VALUES (?, ?, ?, ?, ?)", rows)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise
        except sqlite3.IntegrityError as error:
            raise StoreError(f"{self.path}: another process writes this store; stop it first ({error})") from error
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: not written: {error}") from error
