"""Those who follow events: each with an inbox of its own, so that a slow one holds up nobody."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable
from http import HTTPStatus
from typing import Generic, TypeVar

from autowaze.cloud.api.problems import ProblemError

MOST_UNREAD = 1024
"""Events that a listener may lag behind; one that is slower is let go, and comes back from where it was."""
QUIET_S = 15.0
"""After so long without an event a sign of life is sent, so that proxies keep the connection."""

_Event = TypeVar("_Event")


class Listeners(Generic[_Event]):
    """Passes events on.

    Args:
        most: how many may listen at a time.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self._inboxes: set[asyncio.Queue[_Event | None]] = set()
        self._closed = False

    def __len__(self) -> int:
        """How many listen."""
        return len(self._inboxes)

    @property
    def is_full(self) -> bool:
        """Whether no more may come."""
        return len(self._inboxes) >= self.most

    def require_room(self) -> None:
        """Turn away with `ProblemError` 503 who would be one too many."""
        if self.is_full:
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

    async def listen(self, first: Callable[[], Iterable[_Event]] = tuple) -> AsyncIterator[_Event | None]:
        """Events from now on, after those that came `first`; None when all is quiet; ends when it must."""
        if self._closed:
            return
        inbox: asyncio.Queue[_Event | None] = asyncio.Queue(MOST_UNREAD)
        self._inboxes.add(inbox)
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
