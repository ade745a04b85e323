"""Changes of spots to everyone who listens: server-sent events and WebSockets."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import StreamingResponse

from autowaze.cloud.api.listeners import Listeners
from autowaze.cloud.api.problems import problems
from autowaze.cloud.broadcast import Update

KEPT_EVENTS = 4096
MOST_LISTENERS = 1000

_Version = Annotated[int | None, Query(ge=0, lt=1 << 63, description="Version of the map that the client has seen.")]


@dataclass(frozen=True)
class Event:
    """What happened, and the version of the map by which it had.

    Attributes:
        kind: `spots`: these spots changed. `current`: nothing was missed. `reset`: fetch all spots, some were missed.
            `parking_map`: spots were drawn anew, fetch them all.
    """

    version: int
    kind: str
    data: str

    @cached_property
    def server_sent(self) -> bytes:
        """The event in text/event-stream, made once for all who listen."""
        return f"id: {self.version}\nevent: {self.kind}\ndata: {self.data}\n\n".encode()

    @cached_property
    def message(self) -> str:
        """The event as a WebSocket message."""
        return f'{{"event":"{self.kind}","version":{self.version},"data":{self.data}}}'


class ChangeFeed:
    """Passes updates on to listeners; keeps the newest for those who come back after a gap."""

    def __init__(self, version: int) -> None:
        self._version = self._complete_since = version
        self._events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self.listeners: Listeners[Event] = Listeners(MOST_LISTENERS)

    def publish(self, update: Update) -> None:
        """Tell everyone which spots an update changed; where updates before it never came, that some were missed.

        A commit of which no answer came may have been kept: then the map has gone on, and nobody was told how.
        """
        if update.version > self._version + 1:
            self._start_anew(update.version)
            return
        self._version = update.version
        if not update.spots:
            return
        spots = [
            {
                "spot_id": state.spot_id,
                "state": state.occupancy.value,
                "probability_vacant": round(state.probability_vacant, 4),
                "observed_at": state.observed_at,
            }
            for state in update.spots
        ]
        self._tell(Event(update.version, "spots", json.dumps({"spots": spots}, separators=(",", ":"))))

    def _start_anew(self, version: int) -> None:
        self._version = self._complete_since = version
        self._events.clear()
        self.listeners.tell(Event(version, "reset", "{}"))

    def announce_parking_map(self, version: int) -> None:
        """Tell everyone that spots were drawn anew; `version` is that of the parking map."""
        self._tell(Event(self._version, "parking_map", json.dumps({"version": version})))

    def listen(self, since: int | None, address: str | None = None) -> AsyncIterator[Event | None]:
        """Events from now on, after those missed since a version; None when all is quiet; ends when it must."""
        return self.listeners.listen(lambda: self._missed(since), address)

    def _tell(self, event: Event) -> None:
        if len(self._events) == KEPT_EVENTS:
            self._complete_since = self._events[0].version
        self._events.append(event)
        self.listeners.tell(event)

    def _missed(self, since: int | None) -> list[Event]:
        if since is None:
            return [Event(self._version, "current", "{}")]
        if not self._complete_since <= since <= self._version:
            return [Event(self._version, "reset", "{}")]
        # The parking map changes between versions: whoever has this one may not have heard of it.
        missed = [e for e in self._events if e.version > since or (e.version == since and e.kind == "parking_map")]
        return missed or [Event(self._version, "current", "{}")]


def change_routes(feed: ChangeFeed) -> APIRouter:
    """`/changes` as server-sent events, `/changes/ws` as a WebSocket."""
    router = APIRouter(tags=["changes"])

    @router.get(
        "/changes",
        response_class=StreamingResponse,
        responses={
            200: {
                "content": {"text/event-stream": {}},
                "description": "Events `spots`, `current`, `reset`, `parking_map`",
            },
            **problems(HTTPStatus.BAD_REQUEST, HTTPStatus.SERVICE_UNAVAILABLE),
        },
    )
    async def follow(
        request: Request, since: _Version = None, last_event_id: Annotated[str | None, Header(max_length=20)] = None
    ) -> StreamingResponse:
        """Changes of spots as they happen; a browser's EventSource resumes by itself."""
        address = request.client.host if request.client else None
        feed.listeners.require_room(address)
        resumed = int(last_event_id) if last_event_id and last_event_id.isdecimal() else since

        async def lines() -> AsyncIterator[bytes]:
            async for event in feed.listen(resumed, address):
                yield b": quiet\n\n" if event is None else event.server_sent

        return StreamingResponse(lines(), media_type="text/event-stream", headers={"X-Accel-Buffering": "no"})

    @router.websocket("/changes/ws")
    async def follow_by_socket(socket: WebSocket, since: _Version = None) -> None:
        if not feed.listeners.has_room(socket.client.host if socket.client else None):
            await socket.close(code=1013, reason="too many listen already")
            return
        await socket.accept()
        sending = asyncio.create_task(_send(socket, feed, since))
        with suppress(WebSocketDisconnect):
            while not sending.done():
                receiving: asyncio.Task[Any] = asyncio.create_task(socket.receive())
                await asyncio.wait({sending, receiving}, return_when=asyncio.FIRST_COMPLETED)
                if not receiving.done():
                    receiving.cancel()
                elif receiving.result()["type"] == "websocket.disconnect":
                    break
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)

    return router


async def _send(socket: WebSocket, feed: ChangeFeed, since: int | None) -> None:
    async for event in feed.listen(since, socket.client.host if socket.client else None):
        if event is not None:  # the protocol's own pings are the sign of life
            await socket.send_text(event.message)
    await socket.close(code=1012, reason="come back from the version that you have")
