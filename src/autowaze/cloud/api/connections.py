"""What one connection, and one address, may take of the service before a request has even begun."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

PATIENCE_S = 10.0
"""How long the head of a request may take to come; a car's comes in one packet."""
MOST_HEAD_BYTES = 1 << 16
MOST_PER_ADDRESS = 256
"""Connections of one address; many cars may share that of a mobile network."""
_LOOPBACK = ("127.0.0.1", "::1")
"""A proxy on this machine keeps its own watch."""


class BoundedProtocol(AutoHTTPProtocol):  # type: ignore[misc, valid-type]
    """uvicorn's protocol, with an end to patience: a head that is too slow or too long ends the connection."""

    most_per_address = MOST_PER_ADDRESS
    patience_s = PATIENCE_S
    spared: tuple[str, ...] = _LOOPBACK

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Take a connection, unless its address holds too many."""
        super().connection_made(transport)
        self._waiting: asyncio.TimerHandle | None = None
        self._head_bytes = 0
        address = self.client[0] if self.client else None
        if address is None or address in self.spared:
            self._wait()
            return
        of_address = sum(getattr(c, "client", None) is not None and c.client[0] == address for c in self.connections)
        if of_address > self.most_per_address:
            transport.close()
        else:
            self._wait()

    def data_received(self, data: bytes) -> None:
        """Read on, as long as the head of a request is not too long."""
        before = self.cycle
        reading_head = before is None or before.response_complete
        if reading_head and self._waiting is None:
            self._wait()
        super().data_received(data)
        if self.cycle is not before or self.transport.get_protocol() is not self:
            self._stop_waiting()
        elif reading_head:
            self._head_bytes += len(data)
            if self._head_bytes > MOST_HEAD_BYTES:
                self._give_up()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_waiting()
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._waiting = self.loop.call_later(self.patience_s, self._give_up)

    def _stop_waiting(self) -> None:
        self._head_bytes = 0
        if self._waiting is not None:
            self._waiting.cancel()
        self._waiting = None

    def _give_up(self, *_: Any) -> None:
        self._stop_waiting()
        if not self.transport.is_closing():
            self.transport.close()
