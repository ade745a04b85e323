"""A car's connection to the service: one request at a time, nothing trusted that comes back."""

from __future__ import annotations

import http.client
import logging
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

from autowaze.world.errors import AutowazeError

TIMEOUT_S = 20.0
MOST_ANSWER_BYTES = 1 << 16
_LOOPBACK = ("localhost", "127.0.0.1", "::1")

_log = logging.getLogger(__name__)


class UnreachableError(AutowazeError):
    """The service did not answer, or not in full."""


@dataclass(frozen=True)
class Reply:
    """What came back.

    Attributes:
        headers: names in lower case.
    """

    status: int
    headers: Mapping[str, str]
    body: bytes


def checked_token(url: str, token: str | None) -> str | None:
    """A token that may stand in a header; warns where it would travel in the clear. Raises `AutowazeError`."""
    if (token and not token.isascii()) or any(c in (token or "") for c in "\r\n"):
        raise AutowazeError("the token has characters that no token has")
    if token and url.startswith(("http:", "ws:")) and urlsplit(url).hostname not in _LOOPBACK:
        _log.warning("%s: the token travels in the clear; use https or wss", url)
    return token or None


class CloudConnection:
    """Keeps a connection open between requests; not for several threads.

    Args:
        url: of the service, http or https.
        token: what `autowaze cloud token add` printed, if the service asks for one.
        timeout_s: how long to wait for any byte.

    Raises:
        AutowazeError: the URL is none.
    """

    def __init__(self, url: str, token: str | None = None, timeout_s: float = TIMEOUT_S) -> None:
        parts = urlsplit(url)
        try:
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if parts.scheme not in ("http", "https") or not host:
            raise AutowazeError(f"{url}: not the URL of a service, such as https://parking.example")
        token = checked_token(url, token)
        self.url = url
        self._prefix = parts.path.rstrip("/")
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        if parts.scheme == "https":
            context = ssl.create_default_context()
            self._http: http.client.HTTPConnection = http.client.HTTPSConnection(
                host, port, timeout=timeout_s, context=context
            )
        else:
            self._http = http.client.HTTPConnection(host, port, timeout=timeout_s)

    def get(self, path: str, most_bytes: int = MOST_ANSWER_BYTES) -> Reply:
        """Fetch a path; raises `UnreachableError`."""
        return self._request("GET", path, None, {}, most_bytes)

    def post(self, path: str, body: bytes) -> Reply:
        """Send bytes to a path; raises `UnreachableError`."""
        return self._request("POST", path, body, {"Content-Type": "application/octet-stream"}, MOST_ANSWER_BYTES)

    def close(self) -> None:
        """Let go of the connection."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _request(
        self, method: str, path: str, body: bytes | None, headers: Mapping[str, str], most_bytes: int
    ) -> Reply:
        try:
            response = self._response(method, path, body, {**self._headers, **headers})
            answer = response.read(most_bytes + 1)
            if len(answer) > most_bytes or not response.isclosed():
                raise UnreachableError(f"{self.url}{path}: the answer is longer than {most_bytes} bytes")
            return Reply(response.status, {name.lower(): value for name, value in response.getheaders()}, answer)
        except (OSError, http.client.HTTPException) as error:
            self._http.close()
            raise UnreachableError(f"{self.url}{path}: {error or type(error).__name__}") from error
        except UnreachableError:
            self._http.close()
            raise

    def _response(
        self, method: str, path: str, body: bytes | None, headers: Mapping[str, str]
    ) -> http.client.HTTPResponse:
        """What the service begins to answer; asked once more where it had let go of an idle connection."""
        was_open = self._http.sock is not None
        try:
            self._http.request(method, self._prefix + path, body, headers)
            return self._http.getresponse()
        except ConnectionError:
            if not was_open:
                raise
            self._http.close()
            self._http.request(method, self._prefix + path, body, headers)
            return self._http.getresponse()
