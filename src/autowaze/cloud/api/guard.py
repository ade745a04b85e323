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
from autowaze.cloud.store.tokens import Scope, TokenRegister

MOST_BUCKETS = 1 << 16


@dataclass(frozen=True)
class RateLimit:
    """How often one car may hand in diffs; an outbox that was filled offline comes as a burst."""

    per_second: float = 20.0
    burst: int = 400


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
                raise ProblemError(
                    HTTPStatus.UNAUTHORIZED,
                    "unauthorized",
                    "send a good token: Authorization: Bearer TOKEN",
                    {"WWW-Authenticate": 'Bearer realm="autowaze"'},
                )
            if not known.allows(scope):
                raise ProblemError(HTTPStatus.FORBIDDEN, "forbidden", f"this token lacks the scope {scope}")
            return known.name

        return bearer

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
