"""Cars as they drive, for operators: where they are, and each diff as it arrives."""

from __future__ import annotations

import json
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

import numpy as np
from fastapi import APIRouter, Depends, Request
from fastapi.responses import StreamingResponse
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.listeners import Listeners
from autowaze.cloud.api.problems import ProblemError, problems
from autowaze.cloud.broadcast import Update
from autowaze.cloud.fleet import Fleet
from autowaze.cloud.store.tokens import Scope
from autowaze.world.georeference import Georeference
from autowaze.world.map_diff import SemanticMapDiff

MOST_LISTENERS = 100
ADMITTED_FOR_S = 15.0
"""After so long a listener's token is looked at again: it may have been revoked."""


class Car(BaseModel):
    """Where a car was last."""

    car: str = Field(description="A pseudonym that changes with the car's session and with every start.")
    lon: float
    lat: float
    heading_deg: float = Field(description="Clockwise from north.")
    at: float = Field(description="Seconds since the epoch (UTC).")
    speed_mps: float | None


class Cars(BaseModel):
    """Every car heard of in the last ten minutes."""

    cars: list[Car]


@dataclass(frozen=True)
class FleetEvent:
    """What happened: `car` moved, or a `diff` arrived."""

    kind: str
    data: dict[str, Any]

    def as_server_sent(self) -> str:
        """The event in text/event-stream; without an id, for none is kept."""
        return f"event: {self.kind}\ndata: {json.dumps(self.data, separators=(',', ':'), allow_nan=False)}\n\n"


class FleetFeed:
    """Tells of cars and diffs as they come.

    Args:
        clock: seconds since the epoch (UTC), for the time of receipt.
    """

    def __init__(self, fleet: Fleet, georeference: Georeference, clock: Callable[[], float] = time.time) -> None:
        self.fleet = fleet
        self.listeners: Listeners[FleetEvent] = Listeners(MOST_LISTENERS)
        self._georeference = georeference
        self._clock = clock

    def note(self, update: Update) -> None:
        """Tell of an accepted diff and of its car."""
        diff = update.diff
        if not update.accepted or diff is None:
            return
        report = self.fleet.note(diff)
        if len(self.listeners) == 0:
            return
        if len(report.path):
            columns = (self._lon_lat(report.path.position), _degrees(report.path.heading), report.path.time)
            lists = [column.tolist() for column in columns]
            path = [[*place, heading, round(at, 3)] for place, heading, at in zip(*lists, strict=True)]
            self.listeners.tell(FleetEvent("car", {"car": report.car, "path": path}))
        self.listeners.tell(FleetEvent("diff", self._diff(report.car, diff, update)))

    def cars(self) -> Cars:
        """The fleet now."""
        cars = self.fleet.cars()
        if not cars:
            return Cars(cars=[])
        places = self._lon_lat(np.stack([car.position for car in cars]))
        headings = _degrees(np.array([car.heading_rad for car in cars]))
        return Cars(
            cars=[
                Car(
                    car=car.car,
                    lon=lon,
                    lat=lat,
                    heading_deg=heading,
                    at=car.at,
                    speed_mps=None if car.speed_mps is None else round(car.speed_mps, 2),
                )
                for car, (lon, lat), heading in zip(cars, places.tolist(), headings.tolist(), strict=True)
            ]
        )

    def _diff(self, car: str, diff: SemanticMapDiff, update: Update) -> dict[str, Any]:
        return {
            "car": car,
            "sequence": diff.sequence,
            "bytes": update.diff_bytes,
            "new": len(diff.new),
            "removed": len(diff.removed),
            "received_at": round(self._clock(), 3),
            "map_version": update.version,
        }

    def _lon_lat(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.round(self._georeference.to_lon_lat(positions), 7)


def fleet_routes(feed: FleetFeed, guard: Guard) -> APIRouter:
    """`/fleet` and `/fleet/changes`, both for operators."""
    router = APIRouter(tags=["fleet"])
    admits = guard.admits(Scope.OPERATOR)
    refusals = problems(HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN)

    @router.get("/fleet", dependencies=[Depends(admits)], responses=refusals)
    async def fleet() -> Cars:
        """Every car heard of in the last ten minutes, under a pseudonym."""
        return feed.cars()

    @router.get(
        "/fleet/changes",
        dependencies=[Depends(admits)],
        response_class=StreamingResponse,
        responses={
            200: {"content": {"text/event-stream": {}}, "description": "Events `car` and `diff`"},
            **refusals,
            **problems(HTTPStatus.SERVICE_UNAVAILABLE),
        },
    )
    async def follow(request: Request) -> StreamingResponse:
        """Cars and diffs as they come."""
        address = request.client.host if request.client else None
        feed.listeners.require_room(address)
        lines = _lines(feed, lambda: admits(request), address)
        return StreamingResponse(lines, media_type="text/event-stream", headers={"X-Accel-Buffering": "no"})

    return router


async def _lines(feed: FleetFeed, readmit: Callable[[], Awaitable[str]], address: str | None) -> AsyncIterator[str]:
    """The stream of one listener, for as long as its token is good."""
    yield ": cars and diffs from now on\n\n"
    admitted_at = time.monotonic()
    async for event in feed.listeners.listen(address=address):
        if time.monotonic() - admitted_at > ADMITTED_FOR_S:
            try:
                await readmit()
            except ProblemError:
                return
            admitted_at = time.monotonic()
        yield ": quiet\n\n" if event is None else event.as_server_sent()


def _degrees(radians: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.round(np.degrees(np.asarray(radians, dtype=np.float64)) % 360.0, 1) % 360.0
