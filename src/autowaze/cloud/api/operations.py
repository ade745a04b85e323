"""Whether the service lives, works, and how fast."""

from __future__ import annotations

from http import HTTPStatus

from fastapi import APIRouter, Response
from pydantic import BaseModel

from autowaze import __version__
from autowaze.cloud.api.changes import ChangeFeed
from autowaze.cloud.api.intake import MOST_WAITING, Intake
from autowaze.cloud.api.meters import Meters, ServiceFigures, exposition
from autowaze.cloud.api.problems import ProblemError, problems


class Health(BaseModel):
    """The process answers."""

    status: str = "ok"
    version: str = __version__


def operation_routes(intake: Intake, feed: ChangeFeed, meters: Meters) -> APIRouter:
    """`/health`, `/ready` and `/metrics`."""
    router = APIRouter(tags=["operation"])

    @router.get("/health")
    async def health() -> Health:
        """The process answers; restart it if it does not."""
        return Health()

    @router.get("/ready", responses=problems(HTTPStatus.SERVICE_UNAVAILABLE))
    async def ready() -> Health:
        """Diffs are taken in; send cars elsewhere if not."""
        reason = _not_ready(intake)
        if reason:
            raise ProblemError(HTTPStatus.SERVICE_UNAVAILABLE, "not_ready", reason)
        return Health()

    @router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
    async def metrics() -> Response:
        """Prometheus metrics."""
        figures = await intake.ask(ServiceFigures.of)
        text = exposition(meters, figures, intake.waiting, len(feed.listeners))
        return Response(text, media_type="text/plain; version=0.0.4; charset=utf-8")

    return router


def _not_ready(intake: Intake) -> str:
    if not intake.is_open:
        return "the service is starting or stopping"
    if not intake.keeps:
        return "the last diff could not be kept: see the log of the service, and the disk"
    return "too many diffs wait" if intake.waiting > MOST_WAITING // 2 else ""
