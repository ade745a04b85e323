"""Tokens of cars and operators: shown once, kept as hashes, scoped, revocable at once."""

from __future__ import annotations

import hashlib
import secrets
import sqlite3
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from autowaze.cloud.store.store import StoreError

PREFIX = "awz_"
"""Lets scanners of leaked secrets tell what was leaked."""
_SCHEMA = """
CREATE TABLE IF NOT EXISTS tokens (
    hash BLOB PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    scopes TEXT NOT NULL,
    created_at REAL NOT NULL,
    revoked_at REAL
) WITHOUT ROWID;
"""


class Scope(StrEnum):
    """What a token allows."""

    DIFFS = "diffs"
    """Hand in diffs."""
    MAP = "map"
    """Fetch the feature map."""


@dataclass(frozen=True)
class Token:
    """What is known of a token; the secret itself is not.

    Attributes:
        created_at, revoked_at: seconds since the epoch (UTC).
    """

    name: str
    scopes: frozenset[Scope]
    created_at: float
    revoked_at: float | None = None


class TokenRegister:
    """The tokens in the file of a store; a service and a command line may use it at the same time."""

    def __init__(self, path: str | Path, clock: Callable[[], float] = time.time) -> None:
        self.path = Path(path)
        self._clock = clock
        try:
            self._connection = sqlite3.connect(self.path, isolation_level=None, check_same_thread=False, timeout=5.0)
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.executescript(_SCHEMA)
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: cannot be opened as a store: {error}") from error

    def add(self, name: str, scopes: frozenset[Scope]) -> str:
        """Make a token and return its secret, which is kept nowhere.

        Raises:
            StoreError: the name is taken.
        """
        secret = PREFIX + secrets.token_urlsafe(32)
        row = (_hashed(secret), name, " ".join(sorted(scopes)), self._clock())
        try:
            self._connection.execute("INSERT INTO tokens VALUES (?, ?, ?, ?, NULL)", row)
        except sqlite3.IntegrityError as error:
            raise StoreError(f"{self.path}: there is a token {name!r}: choose another name") from error
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: not written: {error}") from error
        return secret

    def revoke(self, name: str) -> None:
        """Let a token be good no longer; raises `StoreError` if there is none of this name."""
        try:
            done = self._connection.execute(
                "UPDATE tokens SET revoked_at = ? WHERE name = ? AND revoked_at IS NULL", (self._clock(), name)
            )
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: not written: {error}") from error
        if done.rowcount == 0:
            raise StoreError(f"{self.path}: no good token {name!r}: see autowaze cloud token list")

    def find(self, secret: str) -> Token | None:
        """The good token with this secret."""
        tokens = self._select("WHERE hash = ? AND revoked_at IS NULL", (_hashed(secret),))
        return tokens[0] if tokens else None

    def all(self) -> list[Token]:
        """Every token ever made, by name."""
        return self._select("ORDER BY name", ())

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()

    def _select(self, condition: str, parameters: tuple[bytes, ...]) -> list[Token]:
        query = f"SELECT name, scopes, created_at, revoked_at FROM tokens {condition}"
        try:
            rows = self._connection.execute(query, parameters).fetchall()
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: not read: {error}") from error
        return [
            Token(name, frozenset(Scope(scope) for scope in scopes.split()), created, revoked)
            for name, scopes, created, revoked in rows
        ]


def _hashed(secret: str) -> bytes:
    # A fast hash will do: the secret has 256 random bits, there is nothing to guess.
    return hashlib.sha256(secret.encode()).digest()
