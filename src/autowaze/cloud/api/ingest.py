"""Where cars hand in their diffs."""

from __future__ import annotations

import asyncio
import hashlib
import time
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Receive, Send
from starlette.types import Scope as ASGIScope

from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.meters import Meters
from autowaze.cloud.api.problems import ProblemError, problem_of, problems
from autowaze.cloud.api.security import RAW_SECURITY_HEADERS
from autowaze.cloud.store import StoreError
from autowaze.cloud.store.tokens import Scope
from autowaze.world.errors import AutowazeError, WireError
from autowaze.world.wire import MAX_MESSAGE_BYTES

DIFFS = "/v1/diffs"
OCTETS = "application/octet-stream"
PATIENCE_S = 20.0
"""How long a car may take to hand in one diff."""

_RECEIPT = b'{"accepted":%s,"map_version":%d,"sha256":"%s"}'
_BODY: dict[str, Any] = {
    "requestBody": {"required": True, "content": {OCTETS: {"schema": {"type": "string", "format": "binary"}}}}
}


class Receipt(BaseModel):
    """A diff that will not be lost any more.

    Attributes:
        accepted: False if it had been taken in before.
    """

    accepted: bool
    map_version: int
    sha256: str = Field(description="Of the bytes received: the car compares it with what it sent.")


class DiffCounter:
    """Answers `POST /v1/diffs`.

    Args:
        intake: takes the diffs in.
        guard: who may hand them in, and how often.
        meters: count what becomes of them.
    """

    def __init__(self, intake: Intake, guard: Guard, meters: Meters) -> None:
        self._intake, self._guard, self._meters = intake, guard, meters
        self._admits = guard.admits(Scope.DIFFS)

    async def receipt(self, request: Request) -> Response:
        """Take in the diff that a request brings; what it returns says that the diff is durable.

        Raises:
            ProblemError, AutowazeError: it was not taken in.
        """
        arrived = time.perf_counter()
        bearer = await self._admits(request)
        try:
            self._guard.count(bearer)
            payload = await bounded_body(request)
            self._guard.count_bytes(bearer, len(payload))
            update = await self._intake.take_in(payload, self._guard.sender(bearer))
        except (WireError, ProblemError) as error:
            self._meters.refuse(self._guard.refused(bearer, error))
            raise
        except AutowazeError as error:
            self._meters.refuse("not_kept" if isinstance(error, StoreError) else "busy")
            raise
        self._meters.taken_in(update.accepted, len(payload), time.perf_counter() - arrived)
        digest = hashlib.sha256(payload).hexdigest()
        body = _RECEIPT % (b"true" if update.accepted else b"false", update.version, digest.encode())
        status = HTTPStatus.ACCEPTED if update.accepted else HTTPStatus.OK
        return Response(body, status, media_type="application/json")


class DiffsFirst:
    """Answers cars before framework, routing, validation and compression begin, which together cost more than that.

    What comes from a web page goes the whole way: it needs the headers of CORS.
    """

    def __init__(self, app: ASGIApp, counter: DiffCounter) -> None:
        self._app = app
        self._counter = counter

    async def __call__(self, scope: ASGIScope, receive: Receive, send: Send) -> None:
        """Answer a diff, and pass on everything else."""
        if scope["type"] != "http" or scope["path"] != DIFFS or scope["method"] != "POST" or _has_origin(scope):
            await self._app(scope, receive, send)
            return
        request = Request(scope, receive)
        try:
            response = await self._counter.receipt(request)
        except ClientDisconnect:
            return
        except Exception as error:
            response = await problem_of(request, error)
        response.raw_headers += RAW_SECURITY_HEADERS
        await response(scope, receive, send)


def _has_origin(scope: ASGIScope) -> bool:
    return any(name == b"origin" for name, _ in scope["headers"])


def ingest_routes(counter: DiffCounter) -> APIRouter:
    """`/v1/diffs`."""
    router = APIRouter(tags=["cars"])

    @router.post(
        DIFFS,
        status_code=HTTPStatus.ACCEPTED,
        response_model=Receipt,
        openapi_extra=_BODY,
        responses={
            HTTPStatus.OK: {"model": Receipt, "description": "Taken in before; nothing changed"},
            **problems(
                HTTPStatus.BAD_REQUEST,
                HTTPStatus.UNAUTHORIZED,
                HTTPStatus.FORBIDDEN,
                HTTPStatus.REQUEST_TIMEOUT,
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
                HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
                HTTPStatus.UNPROCESSABLE_ENTITY,
                HTTPStatus.TOO_MANY_REQUESTS,
                HTTPStatus.SERVICE_UNAVAILABLE,
            ),
        },
    )
    async def hand_in(request: Request) -> Response:
        """Hand in one semantic map diff. Once this answers, the diff is durable; handing it in again is harmless."""
        return await counter.receipt(request)

    return router


async def bounded_body(
    request: Request, most_bytes: int = MAX_MESSAGE_BYTES, kinds: tuple[str, ...] = (OCTETS,), thing: str = "a diff"
) -> bytes:
    """The body of a request of one of these media types, never more of it than may be taken.

    Raises:
        ProblemError: it is of another type, too large, or too slow to come.
    """
    kind = request.headers.get("content-type", "").split(";")[0].strip().lower()
    if kind not in kinds or request.headers.get("content-encoding", "identity") != "identity":
        raise ProblemError(
            HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "unsupported_media_type", f"send {kinds[0]} without encoding"
        )
    too_large = ProblemError(
        HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too_large", f"{thing} has at most {most_bytes} bytes"
    )
    stated = request.headers.get("content-length", "")
    if stated.isdecimal() and int(stated) > most_bytes:
        raise too_large
    body = bytearray()
    try:
        async with asyncio.timeout(PATIENCE_S):
            async for chunk in request.stream():
                if len(body) + len(chunk) > most_bytes:
                    raise too_large
                body += chunk
    except TimeoutError:
        raise ProblemError(
            HTTPStatus.REQUEST_TIMEOUT, "too_slow", f"{thing} must come within {PATIENCE_S:g} s"
        ) from None
    return bytes(body)
