"""Tokens of cars and operators: shown once, kept as hashes, scoped, revocable at once."""

from __future__ import annotations

import hashlib
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from autowaze.cloud.store.address import open_database
from autowaze.cloud.store.database import ClashError, StoreError

PREFIX = "awz_"
"""Lets scanners of leaked secrets tell what was leaked."""
_GOOD = "revoked_at IS NULL AND (expires_at IS NULL OR expires_at > ?)"


class Scope(StrEnum):
    """What a token allows."""

    DIFFS = "diffs"
    """Hand in diffs."""
    MAP = "map"
    """Fetch the feature map."""
    OPERATOR = "operator"
    """Edit spots, see the fleet and the audit log; fetch the feature map as well."""


@dataclass(frozen=True)
class Token:
    """What is known of a token; the secret itself is not.

    Attributes:
        created_at, revoked_at, expires_at: seconds since the epoch (UTC).
        old_until: until when the secret before the newest one is good, too.
    """

    name: str
    scopes: frozenset[Scope]
    created_at: float
    revoked_at: float | None = None
    expires_at: float | None = None
    old_until: float | None = None

    def allows(self, scope: Scope) -> bool:
        """Whether it may be used for this; an operator may fetch the map too."""
        return scope in self.scopes or (scope is Scope.MAP and Scope.OPERATOR in self.scopes)


class TokenRegister:
    """The tokens in the database of a store; a service and a command line may use it at the same time.

    Args:
        address: of the store, as `open_store` takes it.
        clock: seconds since the epoch (UTC).

    Raises:
        StoreError: the store cannot be opened.
    """

    def __init__(self, address: str | Path, clock: Callable[[], float] = time.time) -> None:
        self._database = open_database(address)
        self._clock = clock

    def add(self, name: str, scopes: frozenset[Scope], expires_at: float | None = None) -> str:
        """Make a token and return its secret, which is kept nowhere.

        Args:
            name: what the car, or the operator, is called.
            scopes: what it allows.
            expires_at: seconds since the epoch (UTC) from which on it is good no longer; None for never.

        Raises:
            StoreError: the name is taken.
        """
        secret = PREFIX + secrets.token_urlsafe(32)
        row = (_hashed(secret), name, " ".join(sorted(scopes)), self._clock(), expires_at)
        try:
            self._database.execute(
                "INSERT INTO tokens (hash, name, scopes, created_at, expires_at) VALUES (?, ?, ?, ?, ?)", row
            )
        except ClashError as error:
            raise StoreError(f"{self._database.name}: there is a token {name!r}: choose another name") from error
        self._note("token added", f"{name}: {', '.join(sorted(scopes))}")
        return secret

    def revoke(self, name: str) -> None:
        """Let a token be good no longer; raises `StoreError` if there is none of this name."""
        done = self._database.execute(
            "UPDATE tokens SET revoked_at = ? WHERE name = ? AND revoked_at IS NULL RETURNING name",
            (self._clock(), name),
        )
        if not done:
            raise StoreError(f"{self._database.name}: no good token {name!r}: see autowaze cloud token list")
        self._note("token revoked", name)

    def rotate(self, name: str, grace_s: float = 0.0) -> str:
        """Give a token a new secret and return it; the one before stays good for a grace period, no older one.

        Raises:
            StoreError: there is no good token of this name.
        """
        secret, now = PREFIX + secrets.token_urlsafe(32), self._clock()
        done = self._database.execute(
            f"UPDATE tokens SET old_hash = hash, old_until = ?, hash = ? WHERE name = ? AND {_GOOD} RETURNING name",
            (now + grace_s, _hashed(secret), name, now),
        )
        if not done:
            raise StoreError(f"{self._database.name}: no good token {name!r}: see autowaze cloud token list")
        self._note("token rotated", name)
        return secret

    def find(self, secret: str) -> Token | None:
        """The good token with this secret.

        Looked up by its hash: how long that takes says nothing of a secret, for nobody can choose the hash of a guess.
        """
        hashed, now = _hashed(secret), self._clock()
        tokens = self._select(f"WHERE hash = ? AND {_GOOD}", (hashed, now))
        tokens = tokens or self._select(f"WHERE old_hash = ? AND old_until > ? AND {_GOOD}", (hashed, now, now))
        return tokens[0] if tokens else None

    def hashes(self, beginning: bytes) -> list[bytes]:
        """SHA-256 hashes of the good tokens that begin so; for messages that prove a token without showing it."""
        now, bounds = self._clock(), (beginning.ljust(32, b"\x00"), beginning.ljust(32, b"\xff"))
        new = f"SELECT hash FROM tokens WHERE hash >= ? AND hash <= ? AND {_GOOD}"
        old = f"SELECT old_hash FROM tokens WHERE old_hash >= ? AND old_hash <= ? AND old_until > ? AND {_GOOD}"
        rows = [*self._database.execute(new, (*bounds, now)), *self._database.execute(old, (*bounds, now, now))]
        return [bytes(found) for (found,) in rows]

    def all(self) -> list[Token]:
        """Every token ever made, by name."""
        return self._select("ORDER BY name", ())

    def close(self) -> None:
        """Let go of the database."""
        self._database.close()

    def _note(self, action: str, detail: str) -> None:
        self._database.execute(
            "INSERT INTO audit (at, actor, action, detail) VALUES (?, ?, ?, ?)", (self._clock(), "", action, detail)
        )

    def _select(self, condition: str, parameters: tuple[bytes | float, ...]) -> list[Token]:
        columns = "name, scopes, created_at, revoked_at, expires_at, old_until"
        rows = self._database.execute(f"SELECT {columns} FROM tokens {condition}", parameters)
        return [
            Token(name, frozenset(Scope(scope) for scope in scopes.split()), *times) for name, scopes, *times in rows
        ]


def open_tokens(address: str | Path, clock: Callable[[], float] = time.time) -> TokenRegister:
    """The tokens in the store at an address; raises `StoreError` if it cannot be opened."""
    return TokenRegister(address, clock)


def _hashed(secret: str) -> bytes:
    # A fast hash will do: the secret has 256 random bits, there is nothing to guess.
    return hashlib.sha256(secret.encode()).digest()
