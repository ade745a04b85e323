"""Whose session is whose, under names that nobody can trace for long.

A token is known here by a pseudonym of the day: a hash of its name under a secret that is drawn each day and deleted
once no diff of that day can come any more. A session is bound to the pseudonym of the token that used it first. With
the secret gone nothing tells which token that was; the binding itself goes with it.
"""

from __future__ import annotations

import hashlib
import secrets
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from autowaze.cloud.store.address import open_database

DAY_S = 86_400.0
KEPT_DAYS = 8
"""A day longer than an outbox may hold a diff back."""
_KEY_BYTES = 32


class _Bound(NamedTuple):
    source: int
    day: int


class SourceRegister:
    """Sessions and the sources that they are bound to, in the database of a store.

    Args:
        address: of the store, as `open_store` takes it.
        clock: seconds since the epoch (UTC).

    Raises:
        StoreError: the store cannot be opened.
    """

    def __init__(self, address: str | Path, clock: Callable[[], float] = time.time) -> None:
        self._database = open_database(address)
        self._clock = clock
        self._lock = threading.Lock()
        self._today = -1
        self._keys: dict[int, bytes] = {}
        self._bound: dict[int, _Bound] = {}
        for session, source, day in self._database.execute("SELECT session, source, day FROM sessions"):
            self._bound[session] = _Bound(source, day)

    def of_token(self, token: str) -> tuple[int, int]:
        """The sources that a token's sessions of today and of yesterday are bound to."""
        with self._lock:
            today = self._turn_page()
            return self._pseudonym(token, today), self._pseudonym(token, today - 1)

    def of_session(self, session: int) -> int | None:
        """The source that a session is bound to; None for none, or where that is forgotten."""
        bound = self._bound.get(session)
        return bound.source if bound else None

    def may_use(self, session: int, token: str) -> bool:
        """Whether a session is bound to this token, or to none yet."""
        with self._lock:
            bound = self._bound.get(session)
            return bound is None or self._pseudonym(token, bound.day) == bound.source

    def bind(self, session: int, token: str) -> int:
        """Bind a session to a token unless it is bound; returns its source.

        It is durable as soon as anything is that is committed to the store after it.

        Raises:
            StoreError: it could not be kept.
        """
        with self._lock:
            today = self._turn_page()
            if session not in self._bound:
                bound = _Bound(self._pseudonym(token, today), today)
                self._database.execute(
                    "INSERT INTO sessions (session, source, day) VALUES (?, ?, ?) ON CONFLICT DO NOTHING",
                    (session, *bound),
                )
                self._bound[session] = bound
            return self._bound[session].source

    def close(self) -> None:
        """Let go of the database."""
        self._database.close()

    def _turn_page(self) -> int:
        """The number of the day; on a new one what is too old is forgotten."""
        today = int(self._clock() // DAY_S)
        if today != self._today:
            self._today = today
            oldest = today - KEPT_DAYS
            with self._database.transaction():
                self._database.execute("DELETE FROM sessions WHERE day < ?", (oldest,))
                self._database.execute("DELETE FROM source_keys WHERE day < ?", (oldest,))
            self._bound = {session: bound for session, bound in self._bound.items() if bound.day >= oldest}
            self._keys = {day: key for day, key in self._keys.items() if day >= oldest}
        return today

    def _pseudonym(self, token: str, day: int) -> int:
        digest = hashlib.blake2b(token.encode(), key=self._key(day), digest_size=8).digest()
        return (int.from_bytes(digest) >> 1) | 1  # fits a signed column, and is never 0

    def _key(self, day: int) -> bytes:
        if day not in self._keys:
            drawn = secrets.token_bytes(_KEY_BYTES)
            self._database.execute(
                "INSERT INTO source_keys (day, secret) VALUES (?, ?) ON CONFLICT DO NOTHING", (day, drawn)
            )
            ((kept,),) = self._database.execute("SELECT secret FROM source_keys WHERE day = ?", (day,))
            self._keys[day] = bytes(kept)
        return self._keys[day]
