"""Who may do what, and how often."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from http import HTTPStatus

from fastapi.requests import HTTPConnection

from autowaze.cloud.api.problems import ProblemError
from autowaze.cloud.api.refusals import RefusalLog
from autowaze.cloud.store.tokens import Scope, TokenRegister

MOST_BUCKETS = 1 << 16
DAY_S = 86_400.0


@dataclass(frozen=True)
class RateLimit:
    """How often one car may hand in diffs; an outbox that was filled offline comes as a burst.

    Attributes:
        per_second, burst: diffs on the whole, and at once.
        bytes_per_day: twice what an outbox holds.
    """

    per_second: float = 20.0
    burst: int = 400
    bytes_per_day: int = 512 << 20


class Guard:
    """Asks for tokens and counts requests.

    Args:
        tokens: the tokens that are good; None lets everyone in, as often as they like.
        limit: how often each of them may hand in diffs.
    """

    def __init__(
        self,
        tokens: TokenRegister | None,
        limit: RateLimit | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._tokens = tokens
        self._limit = limit or RateLimit()
        self._clock = clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()
        self._today: OrderedDict[str, tuple[float, int]] = OrderedDict()
        self.log: RefusalLog | None = None
        """Is told who was refused what."""

    @property
    def tokens(self) -> TokenRegister | None:
        """The tokens that are good; None where nobody needs one."""
        return self._tokens

    def admits(self, scope: Scope) -> Callable[[HTTPConnection], Awaitable[str]]:
        """A dependency that yields the name of who asks, if it holds a token of this scope.

        Raises:
            ProblemError: 401 without a good token, 403 with one of another scope.
        """

        async def bearer(request: HTTPConnection) -> str:
            if self._tokens is None:
                return request.client.host if request.client else "unknown"
            kind, _, secret = request.headers.get("authorization", "").partition(" ")
            known = self._tokens.find(secret.strip()) if kind.lower() == "bearer" else None
            if known is None:
                self._note("", "unauthorized", f"{_address(request)} asked for {request.url.path} without a good token")
                raise ProblemError(
                    HTTPStatus.UNAUTHORIZED,
                    "unauthorized",
                    "send a good token: Authorization: Bearer TOKEN",
                    {"WWW-Authenticate": 'Bearer realm="autowaze"'},
                )
            if not known.allows(scope):
                self._note(known.name, "forbidden", f"{request.url.path} needs the scope {scope}")
                raise ProblemError(HTTPStatus.FORBIDDEN, "forbidden", f"this token lacks the scope {scope}")
            if scope is Scope.OPERATOR:
                self._note(known.name, f"used {request.url.path}"[:80], str(request.scope.get("method", "socket")))
            return known.name

        return bearer

    def refused(self, bearer: str, error: Exception) -> str:
        """Note that a diff was refused; returns of what kind the refusal is."""
        reason = str(getattr(error, "reason", None) or getattr(error, "error", None) or type(error).__name__)
        sender = self.sender(bearer)
        detail = str(getattr(error, "detail", error))
        self._note(sender or "", f"diff refused: {reason}", detail if sender else f"from {bearer}: {detail}")
        return reason

    def turned_away(self, actor: str, reason: str, detail: str) -> None:
        """Note that a diff did not get as far as being judged; the actor is a token's name, empty for nobody known."""
        self._note(actor, f"diff refused: {reason}", detail)

    def count_bytes(self, bearer: str, size: int) -> None:
        """Count the bytes of one diff; raises `ProblemError` 429 when a bearer sends too many a day."""
        if self._tokens is None:
            return
        now = self._clock()
        begun, sent = self._today.pop(bearer, (now, 0))
        if now - begun >= DAY_S:
            begun, sent = now, 0
        fits = sent + size <= self._limit.bytes_per_day
        self._today[bearer] = (begun, sent + size if fits else sent)
        if len(self._today) > MOST_BUCKETS:
            self._today.popitem(last=False)
        if not fits:
            wait_s = math.ceil(begun + DAY_S - now)
            raise ProblemError(
                HTTPStatus.TOO_MANY_REQUESTS,
                "too_many_bytes",
                f"at most {self._limit.bytes_per_day >> 20} MiB a day: send it again in {wait_s} s",
                {"Retry-After": str(wait_s)},
            )

    def _note(self, actor: str, action: str, detail: str) -> None:
        if self.log is not None:
            self.log.note(actor, action, detail)

    def sender(self, bearer: str) -> str | None:
        """The name of the token that a bearer holds; None where nobody needs one."""
        return None if self._tokens is None else bearer

    def count(self, bearer: str) -> None:
        """Count one diff of a bearer; raises `ProblemError` 429 when it sends too many."""
        if self._tokens is None:
            return
        now = self._clock()
        left, then = self._buckets.pop(bearer, (float(self._limit.burst), now))
        left = min(left + (now - then) * self._limit.per_second, float(self._limit.burst))
        self._buckets[bearer] = (max(left - 1.0, 0.0) if left >= 1.0 else left, now)
        if len(self._buckets) > MOST_BUCKETS:
            self._buckets.popitem(last=False)
        if left < 1.0:
            wait_s = math.ceil((1.0 - left) / self._limit.per_second)
            raise ProblemError(
                HTTPStatus.TOO_MANY_REQUESTS,
                "too_many_requests",
                f"at most {self._limit.per_second:g} diffs a second: send it again in {wait_s} s",
                {"Retry-After": str(wait_s)},
            )


def _address(request: HTTPConnection) -> str:
    return request.client.host if request.client else "somebody"
