"""A connection to a database that a store lies in: the few things that SQLite and PostgreSQL do each in its own way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

from autowaze.world.errors import AutowazeError

Row = tuple[Any, ...]


class StoreError(AutowazeError):
    """The store cannot be opened, or did not keep what it was given; what it held before is intact."""


class ClashError(StoreError):
    """A row with this key is there already."""


class Database(Protocol):
    """One connection, safe to use from several threads. Queries mark their parameters with `?`.

    Outside of `transaction` each statement is a transaction of its own. Whatever the database complains of is raised
    as `StoreError`, naming the database and what to do.

    Attributes:
        name: where it lies, without secrets.
    """

    name: str

    def execute(self, query: str, parameters: Sequence[Any] = ()) -> list[Row]:
        """The rows that a statement yields; raises `ClashError` where a key is taken."""

    def execute_many(self, query: str, rows: Iterable[Sequence[Any]]) -> None:
        """Run a statement once for each row of parameters."""

    def insert(self, table: str, columns: str, rows: Iterable[Sequence[Any]]) -> None:
        """Append many rows to a table, the fastest way that the database knows."""

    def transaction(self) -> AbstractContextManager[None]:
        """All of the block or nothing; other threads' statements wait."""

    def close(self) -> None:
        """Let go."""
