"""A store in PostgreSQL with PostGIS, for cities that have one: spots are a layer that GIS tools open."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit, urlunsplit

import numpy as np
import shapely

from autowaze.cloud.store.database import ClashError, Row, StoreError
from autowaze.cloud.store.migrations import pending
from autowaze.cloud.store.sql import SqlStore
from autowaze.world.parking import ParkingMap, SpotState

if TYPE_CHECKING:
    import psycopg

_WRITER, _MIGRATION = 0x4157_415A_0001, 0x4157_415A_0002
"""Advisory locks: of the one process that writes the log, and of one that changes the schema."""
# A connection whose other end is gone shall not hold the writer's lock, or a request, for long.
_PATIENCE: dict[str, Any] = {
    "connect_timeout": 5,
    "tcp_user_timeout": 10_000,
    "options": "-c tcp_keepalives_idle=10 -c tcp_keepalives_interval=5 -c tcp_keepalives_count=3",
}
_UPSERT = (
    "INSERT INTO spots (spot_id, occupancy, probability_vacant, observed_at, evidence) "
    "SELECT * FROM unnest(?::text[], ?::text[], ?::float8[], ?::float8[], ?::text[]) "
    "ON CONFLICT (spot_id) DO UPDATE SET occupancy = excluded.occupancy, observed_at = excluded.observed_at, "
    "probability_vacant = excluded.probability_vacant, evidence = excluded.evidence"
)


class PostgresDatabase:
    """A connection to one database; one that breaks is opened again by the next statement.

    Args:
        url: postgresql://user@host/database, as libpq reads it; a password is better kept in ~/.pgpass or PGPASSWORD.
        writes_alone: take the writer's lock before the first transaction, and keep it.
    """

    def __init__(self, url: str, writes_alone: bool = False) -> None:
        self.name = _without_password(url)
        self._url = url
        self._writes_alone = writes_alone
        self._holds_lock = False
        self._lock = threading.RLock()
        self._connection: psycopg.Connection[Row] | None = None
        try:
            import psycopg
        except ImportError as error:
            raise StoreError(f"{self.name}: PostgreSQL needs: pip install 'autowaze[postgres]'") from error
        self._errors = psycopg.errors
        try:
            self._migrate()
        except BaseException:
            self.close()
            raise

    def execute(self, query: str, parameters: Sequence[Any] = ()) -> list[Row]:
        """The rows that a statement yields."""
        with self._complaining() as connection:
            cursor = connection.execute(_marked(query), parameters)
            return cursor.fetchall() if cursor.description else []

    def execute_many(self, query: str, rows: Iterable[Sequence[Any]]) -> None:
        """Run a statement once for each row of parameters."""
        with self._complaining() as connection, connection.cursor() as cursor:
            cursor.executemany(_marked(query), rows)

    def insert(self, table: str, columns: str, rows: Iterable[Sequence[Any]]) -> None:
        """Append many rows to a table."""
        with self._complaining() as connection, connection.cursor() as cursor:
            statement = f"COPY {table} ({columns}) FROM STDIN".encode()
            with cursor.copy(statement) as copying:
                for row in rows:
                    copying.write_row(row)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All of the block or nothing."""
        with self._complaining() as connection:
            if self._writes_alone and not self._holds_lock:
                self._holds_lock = bool(self.execute("SELECT pg_try_advisory_lock(?)", (_WRITER,))[0][0])
                if not self._holds_lock:
                    raise StoreError(f"{self.name}: another process writes this store; stop it first")
            with connection.transaction():
                yield

    def close(self) -> None:
        """Let go of the connection."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()
            self._connection = None

    def _connected(self) -> psycopg.Connection[Row]:
        import psycopg

        if self._connection is None or self._connection.closed:
            self._holds_lock = False
            self._connection = psycopg.connect(self._url, autocommit=True, **_PATIENCE)
            # A server or role may be set to acknowledge what it has not written yet; the log may not.
            if self._connection.execute("SHOW synchronous_commit").fetchall() == [("off",)]:
                self._connection.execute("SET synchronous_commit = on")
        return self._connection

    def _migrate(self) -> None:
        with self.transaction_of_anyone():
            self.execute("SELECT pg_advisory_xact_lock(?)", (_MIGRATION,))
            self.execute("CREATE TABLE IF NOT EXISTS schema_version (version INTEGER PRIMARY KEY, run_at TIMESTAMPTZ)")
            version = int(self.execute("SELECT coalesce(max(version), 0) FROM schema_version")[0][0])
            if version == 0:
                self._make_geometry_known()
            for number, script in pending("postgres", version, self.name):
                self.execute(script)
                self.execute("INSERT INTO schema_version VALUES (?, now())", (number,))

    @contextmanager
    def transaction_of_anyone(self) -> Iterator[None]:
        """A transaction that needs no writer's lock."""
        with self._complaining() as connection, connection.transaction():
            yield

    def _make_geometry_known(self) -> None:
        errors = self._errors
        try:
            self._connected().execute("CREATE EXTENSION IF NOT EXISTS postgis")
        except (errors.UndefinedFile, errors.FeatureNotSupported) as error:
            raise StoreError(
                f"{self.name}: the server has no PostGIS: install it there (Debian: postgresql-15-postgis-3)"
            ) from error
        except errors.InsufficientPrivilege as error:
            raise StoreError(
                f"{self.name}: let an administrator run CREATE EXTENSION postgis in this database"
            ) from error

    @contextmanager
    def _complaining(self) -> Iterator[psycopg.Connection[Row]]:
        errors = self._errors
        with self._lock:
            try:
                yield self._connected()
            except errors.IntegrityError as error:
                raise ClashError(f"{self.name}: {_first_line(error)}") from error
            except errors.OperationalError as error:
                self.close()
                raise StoreError(f"{self.name}: the database does not answer: {_first_line(error)}") from error
            except errors.Error as error:
                raise StoreError(f"{self.name}: not read or written: {_first_line(error)}") from error


class PostgresStore(SqlStore):
    """A `Store` in one database."""

    def __init__(self, url: str) -> None:
        super().__init__(PostgresDatabase(url, writes_alone=True), PostgresDatabase(url))

    def survey(self, parking_map: ParkingMap) -> None:
        """Show GIS tools where the spots lie."""
        polygons = np.array([spot.polygon for spot in parking_map.spots], dtype=np.object_)
        outlines = shapely.set_srid(shapely.transform(polygons, parking_map.georeference.to_lon_lat), 4326)
        outlines_hex = shapely.to_wkb(shapely.force_2d(outlines), hex=True, include_srid=True).tolist()
        rows = [(spot.id, spot.kind, outline) for spot, outline in zip(parking_map.spots, outlines_hex, strict=True)]
        with self._side.transaction():
            self._side.execute("DELETE FROM spot_outlines")
            self._side.insert("spot_outlines", "spot_id, kind, outline", rows)

    def _upsert(self, states: list[SpotState]) -> None:
        rows = [(s.spot_id, s.occupancy.value, s.probability_vacant, s.observed_at, s.evidence) for s in states]
        if rows:
            self._log.execute(_UPSERT, [list(column) for column in zip(*rows, strict=True)])


@cache
def _marked(query: str) -> bytes:
    """A query with its parameters marked as psycopg has it."""
    return query.replace("%", "%%").replace("?", "%s").encode()


def _without_password(url: str) -> str:
    parts = urlsplit(url)
    user, at, host = parts.netloc.rpartition("@")
    return urlunsplit((parts.scheme, user.split(":")[0] + at + host, parts.path, "", ""))


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n")[0]
