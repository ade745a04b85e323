"""Where cars hand in their diffs."""

from __future__ import annotations

import asyncio
import hashlib
import time
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Depends, Request, Response
from pydantic import BaseModel, Field

from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.meters import Meters
from autowaze.cloud.api.problems import ProblemError, problems
from autowaze.cloud.store import StoreError
from autowaze.cloud.store.tokens import Scope
from autowaze.world.errors import AutowazeError, WireError
from autowaze.world.wire import MAX_MESSAGE_BYTES

OCTETS = "application/octet-stream"
PATIENCE_S = 20.0
"""How long a car may take to hand in one diff."""

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


def ingest_routes(intake: Intake, guard: Guard, meters: Meters) -> APIRouter:
    """`/v1/diffs`."""
    router = APIRouter(tags=["cars"])
    admitted = Depends(guard.admits(Scope.DIFFS))

    @router.post(
        "/v1/diffs",
        status_code=HTTPStatus.ACCEPTED,
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
    async def hand_in(request: Request, response: Response, bearer: str = admitted) -> Receipt:
        """Hand in one semantic map diff. Once this answers, the diff is durable; handing it in again is harmless."""
        arrived = time.perf_counter()
        try:
            guard.count(bearer)
            payload = await bounded_body(request)
            guard.count_bytes(bearer, len(payload))
            update = await intake.take_in(payload, guard.sender(bearer))
        except (WireError, ProblemError) as error:
            meters.refuse(guard.refused(bearer, error))
            raise
        except AutowazeError as error:
            meters.refuse("not_kept" if isinstance(error, StoreError) else "busy")
            raise
        meters.taken_in(update.accepted, len(payload), time.perf_counter() - arrived)
        if not update.accepted:
            response.status_code = HTTPStatus.OK
        digest = hashlib.sha256(payload).hexdigest()
        return Receipt(accepted=update.accepted, map_version=update.version, sha256=digest)

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
