"""Those who follow events: each with an inbox of its own, so that a slow one holds up nobody."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from http import HTTPStatus
from typing import Generic, TypeVar

from autowaze.cloud.api.problems import ProblemError

MOST_UNREAD = 1024
"""Events that a listener may lag behind; one that is slower is let go, and comes back from where it was."""
QUIET_S = 15.0
"""After so long without an event a sign of life is sent, so that proxies keep the connection."""

MOST_PER_ADDRESS = 64
"""Listeners of one address; some people share that of an office."""
SPARED = ("127.0.0.1", "::1")
"""A proxy on this machine keeps its own watch."""

_Event = TypeVar("_Event")


class Listeners(Generic[_Event]):
    """Passes events on.

    Args:
        most: how many may listen at a time.
        per_address: how many of them from one address.
        spared: addresses of which any number may come.
    """

    def __init__(self, most: int, per_address: int = MOST_PER_ADDRESS, spared: Sequence[str] = SPARED) -> None:
        self.most = most
        self._per_address = per_address
        self._spared = spared
        self._addresses: Counter[str] = Counter()
        self._inboxes: set[asyncio.Queue[_Event | None]] = set()
        self._closed = False

    def __len__(self) -> int:
        """How many listen."""
        return len(self._inboxes)

    def has_room(self, address: str | None = None) -> bool:
        """Whether one more may come from an address."""
        crowded = address not in self._spared and self._addresses[address or ""] >= self._per_address
        return len(self._inboxes) < self.most and not crowded

    def require_room(self, address: str | None = None) -> None:
        """Turn away with `ProblemError` 503 who would be one too many, on the whole or of an address."""
        if not self.has_room(address):
            raise ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "busy", "too many listen already: come back later", {"Retry-After": "2"}
            )

    def tell(self, event: _Event) -> None:
        """Pass an event on to all who listen."""
        for inbox in list(self._inboxes):
            try:
                inbox.put_nowait(event)
            except asyncio.QueueFull:
                self._let_go(inbox)

    async def listen(
        self, first: Callable[[], Iterable[_Event]] = tuple, address: str | None = None
    ) -> AsyncIterator[_Event | None]:
        """Events from now on, after those that came `first`; None when all is quiet; ends when it must."""
        if self._closed:
            return
        inbox: asyncio.Queue[_Event | None] = asyncio.Queue(MOST_UNREAD)
        self._inboxes.add(inbox)
        self._addresses[address or ""] += 1
        try:
            for event in first():
                yield event
            while True:
                try:
                    next_event = await asyncio.wait_for(inbox.get(), QUIET_S)
                except TimeoutError:
                    yield None
                    continue
                if next_event is None:
                    return
                yield next_event
        finally:
            self._inboxes.discard(inbox)
            self._addresses[address or ""] -= 1
            self._addresses += Counter()  # forgets those of whom nobody is left

    def close(self) -> None:
        """Let every listener go, and those who come."""
        self._closed = True
        for inbox in list(self._inboxes):
            self._let_go(inbox)

    def _let_go(self, inbox: asyncio.Queue[_Event | None]) -> None:
        self._inboxes.discard(inbox)
        while not inbox.empty():
            inbox.get_nowait()
        inbox.put_nowait(None)
