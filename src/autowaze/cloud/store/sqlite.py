"""A store in one SQLite file with a write-ahead log: needs nothing installed, survives kill -9 and power cuts."""

from __future__ import annotations

import fcntl
import os
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from autowaze.cloud.store.database import ClashError, Row, StoreError
from autowaze.cloud.store.migrations import pending
from autowaze.cloud.store.sql import SqlStore

_PATIENCE_S = 5.0
"""How long a statement waits for another process that writes."""
_MOST_PAGES = 1 << 16
"""Of the write-ahead log: from 256 MB on each commit moves some of it into the database and waits for the disk."""
_BEGIN_ANEW_PAGES = 1 << 12
"""A log that writers never leave alone has no end; from 16 MB on they wait while the newest pages are moved."""


class SqliteDatabase:
    """A connection to one file.

    Args:
        path: made if there is none.
        durable: whether a commit survives a power cut; it always survives the end of the process.
        writes_alone: take the writer's lock, a file beside the database, before the first transaction, and keep it.
        turns: is held while something is written. Connections of one process that share it take turns at once; SQLite
            lets who comes second sleep, for up to 100 ms at a time.
    """

    def __init__(
        self,
        path: str | Path,
        durable: bool = True,
        writes_alone: bool = False,
        turns: AbstractContextManager[object] | None = None,
    ) -> None:
        self.name = str(path)
        self._writes_alone = writes_alone
        self._turns = turns or threading.RLock()
        self._writing: int | None = None
        self._lock = threading.RLock()
        try:
            self._connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False, timeout=_PATIENCE_S)
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.execute(f"PRAGMA wal_autocheckpoint = {_MOST_PAGES}")
            # In a WAL, NORMAL may lose the newest commits in a power cut.
            self._connection.execute(f"PRAGMA synchronous = {'FULL' if durable else 'NORMAL'}")
        except sqlite3.Error as error:
            raise StoreError(f"{path}: cannot be opened as a store: {error}") from error
        self._migrate()

    def execute(self, query: str, parameters: Sequence[Any] = ()) -> list[Row]:
        """The rows that a statement yields."""
        turn = nullcontext() if query.startswith(("SELECT", "PRAGMA")) else self._turns
        with self._complaining(), self._lock, turn:
            return self._connection.execute(query, parameters).fetchall()

    def execute_many(self, query: str, rows: Iterable[Sequence[Any]]) -> None:
        """Run a statement once for each row of parameters."""
        with self._complaining(), self._lock, self._turns:
            self._connection.executemany(query, rows)

    def insert(self, table: str, columns: str, rows: Iterable[Sequence[Any]]) -> None:
        """Append many rows to a table."""
        marks = ", ".join("?" for _ in columns.split(","))
        self.execute_many(f"INSERT INTO {table} ({columns}) VALUES ({marks})", rows)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All of the block or nothing."""
        with self._lock:
            if self._writes_alone and self._writing is None:
                self._writing = self._locked()
            with self._transaction():
                yield

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        with self._complaining(), self._lock, self._turns:
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()
        if self._writing is not None:
            os.close(self._writing)
            self._writing = None

    def _locked(self) -> int:
        """A descriptor of the lock; the end of the process lets go of it, however that comes."""
        descriptor = os.open(f"{self.name}-writer", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            raise StoreError(f"{self.name}: another process writes this store; stop it first") from error
        return descriptor

    def _migrate(self) -> None:
        if not pending("sqlite", self._version(), self.name):
            return
        with self._transaction():  # another process may be at it too: the first one does it
            for number, script in pending("sqlite", self._version(), self.name):
                for statement in filter(str.strip, script.split(";")):
                    self.execute(statement)
                self.execute(f"PRAGMA user_version = {number}")

    def _version(self) -> int:
        return int(self.execute("PRAGMA user_version")[0][0])

    @contextmanager
    def _complaining(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.IntegrityError as error:
            raise ClashError(f"{self.name}: {error}") from error
        except sqlite3.Error as error:
            raise StoreError(f"{self.name}: not read or written: {error}") from error


class SqliteStore(SqlStore):
    """A `Store` in one file."""

    def __init__(self, path: str | Path) -> None:
        turns = threading.RLock()
        log = SqliteDatabase(path, writes_alone=True, turns=turns)
        super().__init__(log, SqliteDatabase(path, durable=False, turns=turns))
        self.path = Path(path)

    def tidy(self) -> None:
        """Move the write-ahead log into the database."""
        try:
            with closing(sqlite3.connect(self.path, isolation_level=None, timeout=_PATIENCE_S)) as connection:
                _, pages, _ = connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
                if pages >= _BEGIN_ANEW_PAGES:
                    connection.execute("PRAGMA wal_checkpoint(RESTART)")
        except sqlite3.Error as error:
            raise StoreError(f"{self.name}: its log cannot be moved into the database: {error}") from error
