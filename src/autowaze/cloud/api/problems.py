"""What a client is told when something is wrong: a status and a JSON body, as CDS has it."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from autowaze.cloud.admission import ForeignSessionError
from autowaze.cloud.api.intake import BusyError
from autowaze.cloud.broadcast import OutdatedMapError
from autowaze.cloud.spot_edits import ClashingEditError, RefusedEditError
from autowaze.cloud.store import StoreError
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.errors import AutowazeError, WireError

_log = logging.getLogger(__name__)

_STATUS_OF: tuple[tuple[type[AutowazeError], HTTPStatus, str], ...] = (
    (ForeignSessionError, HTTPStatus.FORBIDDEN, "foreign_session"),
    (RefusedDiffError, HTTPStatus.UNPROCESSABLE_ENTITY, "diff_refused"),
    (WireError, HTTPStatus.BAD_REQUEST, "not_a_diff"),
    (OutdatedMapError, HTTPStatus.GONE, "map_outdated"),
    (ClashingEditError, HTTPStatus.CONFLICT, "spot_clashes"),
    (RefusedEditError, HTTPStatus.UNPROCESSABLE_ENTITY, "spot_refused"),
    (BusyError, HTTPStatus.SERVICE_UNAVAILABLE, "busy"),
    (StoreError, HTTPStatus.SERVICE_UNAVAILABLE, "not_kept"),
)
RETRY_AFTER_S = 2


class Problem(BaseModel):
    """Why a request was not fulfilled.

    Attributes:
        error: for a program.
        error_description: for a person.
        error_details: what exactly was wrong, one line each.
    """

    error: str
    error_description: str
    error_details: list[str] = []


_BAD_REQUEST: dict[str, Any] = {
    "description": HTTPStatus.BAD_REQUEST.phrase,
    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
}


class ProblemError(HTTPException):
    """A request that cannot be fulfilled."""

    def __init__(
        self, status: HTTPStatus, error: str, description: str, headers: Mapping[str, str] | None = None
    ) -> None:
        super().__init__(status, description, dict(headers or {}))
        self.error = error


def problems(*statuses: HTTPStatus) -> dict[int | str, dict[str, Any]]:
    """The responses of a route, for OpenAPI."""
    return {int(status): {"model": Problem, "description": status.phrase} for status in statuses}


NEEDS_TOKEN = problems(HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN)
"""Responses of a route that asks for a token."""


def answer_with_problems(app: FastAPI) -> None:
    """Let every error of this application leave as a `Problem`."""
    app.add_exception_handler(HTTPException, _of_http)
    app.add_exception_handler(RequestValidationError, _of_validation)
    app.add_exception_handler(AutowazeError, _of_ours)
    app.add_exception_handler(Exception, _of_the_unexpected)
    described = app.openapi
    app.openapi = lambda: app.openapi_schema or describe_problems(described())  # type: ignore[method-assign]


def describe_problems(document: dict[str, Any]) -> dict[str, Any]:
    """An OpenAPI document that says what FastAPI cannot know.

    Bad parameters are answered with 400 and a `Problem`; what may answer 401 takes a token.
    """
    for operations in document["paths"].values():
        for operation in operations.values():
            unlike_ours = operation["responses"].get("422", {}).get("content", {}).get("application/json", {})
            if unlike_ours.get("schema", {}).get("$ref", "").endswith("/HTTPValidationError"):
                del operation["responses"]["422"]
            if operation.get("parameters") or "requestBody" in operation:
                operation["responses"].setdefault("400", _BAD_REQUEST)
            if str(int(HTTPStatus.UNAUTHORIZED)) in operation["responses"]:
                operation["security"] = [{"token": []}]
    schemas = document.get("components", {}).get("schemas", {})
    for unused in ("HTTPValidationError", "ValidationError"):
        schemas.pop(unused, None)
    schemas.setdefault("Problem", Problem.model_json_schema())
    document["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
    return document


def problem_response(
    status: int,
    error: str,
    description: str,
    details: list[str] | None = None,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """A `Problem` as a response."""
    body = Problem(error=error, error_description=description, error_details=details or [])
    return JSONResponse(body.model_dump(), status, headers)


async def problem_of(request: Request, error: Exception) -> JSONResponse:
    """What an application that `answer_with_problems` says of an error."""
    if isinstance(error, HTTPException):
        return await _of_http(request, error)
    return await _of_ours(request, error)


async def _of_http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    name = error.error if isinstance(error, ProblemError) else HTTPStatus(error.status_code).name.lower()
    return problem_response(error.status_code, name, error.detail, headers=error.headers)


async def _of_validation(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    details = [f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors()]
    return problem_response(HTTPStatus.BAD_REQUEST, "bad_parameter", "a parameter is out of range", details)


async def _of_ours(request: Request, error: Exception) -> JSONResponse:
    for kind, status, name in _STATUS_OF:
        if isinstance(error, kind):
            again = {"Retry-After": str(RETRY_AFTER_S)} if status is HTTPStatus.SERVICE_UNAVAILABLE else None
            description = "it could not be kept" if kind is StoreError else str(error)
            details = error.faults if isinstance(error, RefusedEditError) else None
            return problem_response(status, name, description, details, again)
    return await _of_the_unexpected(request, error)


async def _of_the_unexpected(request: Request, error: Exception) -> JSONResponse:
    _log.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return problem_response(HTTPStatus.INTERNAL_SERVER_ERROR, "internal", "the service failed at this request")
