"""How spots changed, to play a day again."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from autowaze.cloud.api.problems import ProblemError, problems
from autowaze.cloud.api.spot_book import BelievedSpots, FadingStates, SpotBook
from autowaze.cloud.store import Store
from autowaze.world.parking import Occupancy, SpotState

MOST_CHANGES = 10_000
LATEST = 1e11
"""Seconds since the epoch; nobody asks for the sixth millennium."""

Moment = Annotated[float, Query(ge=0, le=LATEST, allow_inf_nan=False, description="Seconds since the epoch (UTC).")]


class Change(BaseModel):
    """A spot that changed."""

    number: int
    received_at: float = Field(description="Seconds since the epoch (UTC).")
    spot_id: str
    state: Literal["vacant", "occupied", "unknown"]
    probability_vacant: float = Field(ge=0, le=1)
    observed_at: float | None = Field(description="When a car saw it, seconds since the epoch (UTC).")


class Changes(BaseModel):
    """A page of changes, the oldest first."""

    changes: list[Change]
    next: int | None = Field(description="Ask on with `after` this number; null at the end.")


class Extent(BaseModel):
    """When the oldest and the newest change kept were received; null without any."""

    start: float | None
    end: float | None


class SpotHistory:
    """Reads the history of a store.

    Args:
        store: keeps it.
        book: the spots and the service's method.
        replays: whether drives of another day are replayed; then a past state, too, stands at its newest observation.
    """

    def __init__(self, store: Store, book: SpotBook, replays: bool) -> None:
        self._store = store
        self._book = book
        self._replays = replays

    async def changes(self, start: float, end: float, limit: int, after: int) -> Changes:
        """Changes received in a time."""
        found = await asyncio.to_thread(self._store.history, start, end, limit + 1, after)
        page = found[:limit]
        changes = [
            Change(
                number=change.number,
                received_at=change.received_at,
                spot_id=change.state.spot_id,
                state=change.state.occupancy.value,
                probability_vacant=round(change.state.probability_vacant, 4),
                observed_at=change.state.observed_at,
            )
            for change in page
        ]
        return Changes(changes=changes, next=page[-1].number if len(found) > limit else None)

    async def extent(self) -> Extent:
        """Of what is kept."""
        found = await asyncio.to_thread(self._store.history_extent)
        start, end = found if found is not None else (None, None)
        return Extent(start=start, end=end)

    async def believed_at(self, time: float) -> BelievedSpots:
        """The spots of today as they were believed at a time; those not seen until then are unknown."""
        today = await self._book.believed()
        kept = await asyncio.to_thread(self._store.spots_at, time)
        return await asyncio.to_thread(self._then, today, kept, time)

    def _then(self, today: BelievedSpots, kept: list[SpotState], time: float) -> BelievedSpots:
        known = {state.spot_id: state for state in kept}
        states = [known.get(spot_id) or SpotState(spot_id, Occupancy.UNKNOWN) for spot_id in today.sheet.ids]
        if self._replays:
            time = max((s.observed_at for s in states if s.observed_at is not None), default=0.0)
        return BelievedSpots(FadingStates(states, time, today.states.fades), time, today.version, today.sheet)


def history_routes(history: SpotHistory) -> APIRouter:
    """`/history` and `/history/extent`."""
    router = APIRouter(tags=["history"])

    @router.get("/history", responses=problems(HTTPStatus.BAD_REQUEST))
    async def changes(
        start: Moment = 0.0,
        end: Moment = LATEST,
        limit: Annotated[int, Query(ge=1, le=MOST_CHANGES)] = 1000,
        after: Annotated[int, Query(ge=0, lt=1 << 63, description="Only changes with higher numbers.")] = 0,
    ) -> Changes:
        """Every change of a spot that was received in a time, a page at a time."""
        if start > end:
            raise ProblemError(HTTPStatus.BAD_REQUEST, "bad_parameter", "start lies after end")
        return await history.changes(start, end, limit, after)

    @router.get("/history/extent")
    async def extent() -> Extent:
        """From when to when changes are kept."""
        return await history.extent()

    return router
