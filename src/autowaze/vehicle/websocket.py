"""Diffs to the service over one WebSocket for the whole drive."""

from __future__ import annotations

import hashlib
import ssl
from contextlib import ExitStack

from websockets.exceptions import ConnectionClosed, InvalidURI, WebSocketException
from websockets.sync.client import ClientConnection, connect

from autowaze.vehicle.connection import TIMEOUT_S, checked_token
from autowaze.vehicle.uplink import DIFFS_PATH, Answer, Outcome
from autowaze.world.acknowledgement import MOST_BYTES, Verdict, decode_acknowledgement
from autowaze.world.errors import AutowazeError, WireError


class WebSocketTransport:
    """Hands diffs in over a WebSocket; it is opened again when it has broken.

    Args:
        url: of the service, ws or wss.
        token: what `autowaze cloud token add` printed, if the service asks for one.
        timeout_s: how long to wait for an acknowledgement.

    Raises:
        AutowazeError: the URL or the token is none.
    """

    def __init__(self, url: str, token: str | None = None, timeout_s: float = TIMEOUT_S) -> None:
        if not url.startswith(("ws://", "wss://")):
            raise AutowazeError(f"{url}: not the URL of a service, such as wss://parking.example")
        self.url = url
        self._token = checked_token(url, token)
        self._timeout_s = timeout_s
        self._socket: ClientConnection | None = None
        self._connection = ExitStack()

    def hand_in(self, message: bytes) -> Answer:
        """Try once; only an answer that names the very bytes sent is an acknowledgement."""
        try:
            socket = self._open_socket()
            socket.send(message)
            reply = socket.recv(self._timeout_s)
            answer = decode_acknowledgement(reply if isinstance(reply, bytes) else reply.encode())
        except (OSError, TimeoutError, WebSocketException, WireError) as error:
            self._drop_socket()
            return Answer(Outcome.LATER, f"{self.url}: {_in_words(error)}")
        if answer.sha256 != hashlib.sha256(message).hexdigest():
            self._drop_socket()
            return Answer(Outcome.LATER, f"{self.url}: acknowledges another diff")
        if answer.verdict in (Verdict.ACCEPTED, Verdict.REPEATED):
            return Answer(Outcome.ACKNOWLEDGED)
        outcome = Outcome.REFUSED if answer.verdict is Verdict.REFUSED else Outcome.LATER
        return Answer(outcome, f"{self.url}: {answer.reason}", answer.wait_s)

    def close(self) -> None:
        """Let go of the connection."""
        self._drop_socket()

    def _open_socket(self) -> ClientConnection:
        if self._socket is None:
            opening = connect(
                self.url.rstrip("/") + DIFFS_PATH + "/ws",
                ssl=ssl.create_default_context() if self.url.startswith("wss:") else None,
                additional_headers={"Authorization": f"Bearer {self._token}"} if self._token else None,
                compression=None,  # diffs are
                open_timeout=self._timeout_s,
                close_timeout=1.0,
                max_size=MOST_BYTES,
                proxy=None,
            )
            self._socket = self._connection.enter_context(opening)
        return self._socket

    def _drop_socket(self) -> None:
        self._socket = None
        self._connection.close()


def _in_words(error: Exception) -> str:
    if isinstance(error, ConnectionClosed) and error.rcvd is not None:
        return error.rcvd.reason or f"closed with {error.rcvd.code}"
    if isinstance(error, InvalidURI):
        return "not the URL of a service"
    return str(error) or type(error).__name__
