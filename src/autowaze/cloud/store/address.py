"""Where a store lies: a file for SQLite, a URL for PostgreSQL."""

from __future__ import annotations

from pathlib import Path

from autowaze.cloud.store.database import Database
from autowaze.cloud.store.sqlite import SqliteDatabase, SqliteStore
from autowaze.cloud.store.store import Store


def open_store(address: str | Path) -> Store:
    """The store at a path, or at postgresql://user@host/database; its tables are made if there are none.

    Raises:
        StoreError: it cannot be opened.
    """
    if is_postgres(address):
        from autowaze.cloud.store.postgres import PostgresStore

        return PostgresStore(str(address))
    return SqliteStore(address)


def open_database(address: str | Path) -> Database:
    """A connection of its own to the database of a store."""
    if is_postgres(address):
        from autowaze.cloud.store.postgres import PostgresDatabase

        return PostgresDatabase(str(address))
    return SqliteDatabase(address)


def is_postgres(address: str | Path) -> bool:
    """Whether an address is the URL of a PostgreSQL database; anything else is a path."""
    return isinstance(address, str) and address.startswith(("postgresql://", "postgres://"))
