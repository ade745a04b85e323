"""Where a store lies: a file for SQLite."""

from __future__ import annotations

from pathlib import Path

from autowaze.cloud.store.database import Database
from autowaze.cloud.store.sqlite import SqliteDatabase, SqliteStore
from autowaze.cloud.store.store import Store


def open_store(address: str | Path) -> Store:
    """The store at a path, made if there is none.

    Raises:
        StoreError: it cannot be opened.
    """
    return SqliteStore(address)


def open_database(address: str | Path) -> Database:
    """A connection of its own to the database of a store."""
    return SqliteDatabase(address)
