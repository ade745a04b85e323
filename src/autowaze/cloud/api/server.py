"""Runs the web service on a socket until it is told to stop."""

from __future__ import annotations

import gc
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import uvicorn
from fastapi import FastAPI

from autowaze.cloud.api.connections import BoundedProtocol
from autowaze.cloud.api.ingest import DiffsFirst
from autowaze.world.errors import AutowazeError
from autowaze.world.wire import MAX_MESSAGE_BYTES

MOST_CONNECTIONS = 4096
SWITCH_S = 0.0005
"""How long the thread that takes diffs in may keep the interpreter while requests wait; with Python's 5 ms half of the
time of a diff is spent waiting for it."""
MOST_YOUNG, YOUNG_ROUNDS, NEVER = 500, 20, 1 << 30
"""When Python looks for cycles among objects: among the young ones once there are so many more, which takes 10 ms as
most take the place of others that are gone, and after so many rounds among those that were young since the last time;
never among older ones. All that a city's service holds takes a third of a second: upkeep looks there once an hour."""
IDLE_S = 60
"""How long a connection may wait for its next request: a car hands in a diff every few seconds while it drives."""
GRACE_S = 5
"""How long requests may go on after the order to stop."""


class WebServer(uvicorn.Server):
    """uvicorn, but those who follow changes are let go first: they would never end by themselves.

    Args:
        app: what `create_app` made.
        certificate, key: PEM files for TLS.
        announce: is called when requests are answered.

    Raises:
        AutowazeError: certificate and key cannot be used.
    """

    def __init__(
        self,
        app: FastAPI,
        certificate: Path | None = None,
        key: Path | None = None,
        announce: Callable[[], None] | None = None,
    ) -> None:
        if (certificate is None) != (key is None):
            raise AutowazeError("TLS needs both --certificate and --key")
        super().__init__(
            uvicorn.Config(
                DiffsFirst(app, app.state.counter),
                ssl_certfile=certificate,
                ssl_keyfile=key,
                http=BoundedProtocol,
                access_log=False,
                log_config=None,
                server_header=False,
                ws="websockets-sansio",
                ws_max_size=MAX_MESSAGE_BYTES,
                limit_concurrency=MOST_CONNECTIONS,
                timeout_keep_alive=IDLE_S,
                timeout_graceful_shutdown=GRACE_S,
            )
        )
        try:
            self.config.load()
        except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
            raise AutowazeError(f"{certificate}, {key}: not usable for TLS: {error}") from error
        self._listeners = app.state.listeners
        self._announce = announce

    def run(self, sockets: list[socket.socket] | None = None) -> None:
        """Serve until told to stop."""
        before, thresholds = sys.getswitchinterval(), gc.get_threshold()
        sys.setswitchinterval(SWITCH_S)
        gc.freeze()
        gc.set_threshold(MOST_YOUNG, YOUNG_ROUNDS, NEVER)
        try:
            super().run(sockets)
        finally:
            gc.set_threshold(*thresholds)
            gc.unfreeze()
            sys.setswitchinterval(before)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to answer requests."""
        await super().startup(sockets)
        if self.started and self._announce is not None:
            self._announce()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop, at a signal."""
        super().handle_exit(sig, frame)
        self.stop()

    def stop(self) -> None:
        """Stop soon."""
        self.should_exit = True
        for listeners in self._listeners:
            listeners.close()


def listening_socket(host: str, port: int) -> socket.socket:
    """A socket that cars can connect to; port 0 chooses a free one.

    Raises:
        AutowazeError: the address is taken or not of this machine.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        # asyncio turns Nagle's delay of 40 ms off only where the protocol is named; socket.create_server does not.
        listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(1024)
    except OSError as error:
        raise AutowazeError(f"cannot listen on {host} port {port}: {error.strerror or error}") from error
    return listening
