"""A handful of figures for the live map's panel, cheap enough to be asked for every second."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import numpy as np
from fastapi import APIRouter
from pydantic import BaseModel, Field

from autowaze.cloud.api.changes import ChangeFeed
from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.meters import Meters
from autowaze.cloud.api.spot_book import SpotBook
from autowaze.cloud.broadcast import Update
from autowaze.world.parking import Occupancy

FRESH_S = 1.0
"""Those who ask within this time get the same answer."""


class SpotCounts(BaseModel):
    """Spots by what is believed of them now."""

    vacant: int
    occupied: int
    unknown: int


class DiffFigures(BaseModel):
    """Diffs of the running process; repeated ones count too."""

    total: int
    per_second: float = Field(description="Over the last minute.")
    bytes_total: int


class DelayFigures(BaseModel):
    """From the arrival of a diff to durable and broadcast, over the last minute, milliseconds."""

    p50: float | None
    p99: float | None


class Stats(BaseModel):
    """The service at a glance."""

    uptime_s: float
    map_version: int
    map_features: int
    spots: SpotCounts
    diffs: DiffFigures
    delay_ms: DelayFigures
    stages_ms: dict[str, float] = Field(description="Median time of each stage of the newest diffs.")
    listeners: int


class Panel:
    """Gathers the figures.

    Args:
        map_features: features of the map when the process starts; from then on they are counted.
    """

    def __init__(
        self,
        book: SpotBook,
        intake: Intake,
        feed: ChangeFeed,
        meters: Meters,
        map_features: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._book, self._intake, self._feed, self._meters = book, intake, feed, meters
        self._map_features = map_features
        self._clock = clock
        self._started = clock()
        self._counting = asyncio.Lock()
        self._counted_at = -np.inf
        self._stats: Stats | None = None

    def note(self, update: Update) -> None:
        """Follow the size of the map."""
        self._map_features += len(update.map.added) - len(update.map.removed)

    async def stats(self) -> Stats:
        """The figures of this second."""
        async with self._counting:
            now = self._clock()
            if self._stats is None or now - self._counted_at >= FRESH_S:
                self._stats = await self._gathered(now)
                self._counted_at = now
            return self._stats

    async def _gathered(self, now: float) -> Stats:
        believed = await self._book.believed()
        stages = await self._intake.ask(lambda service: service.times.median_ms())
        counts = await asyncio.to_thread(believed.states.counts)
        recent = self._meters.recent(now)
        p50, p99 = np.percentile(recent.delays_ms, [50, 99]).round(2).tolist() if recent.delays_ms else (None, None)
        return Stats(
            uptime_s=round(now - self._started, 1),
            map_version=believed.version,
            map_features=self._map_features,
            spots=SpotCounts(**{state.value: counts[state] for state in Occupancy}),
            diffs=DiffFigures(
                total=self._meters.accepted + self._meters.repeated,
                per_second=round(recent.per_second, 2),
                bytes_total=self._meters.received_bytes,
            ),
            delay_ms=DelayFigures(p50=p50, p99=p99),
            stages_ms={stage: round(ms, 3) for stage, ms in stages.items()},
            listeners=len(self._feed.listeners),
        )


def stats_routes(panel: Panel) -> APIRouter:
    """`/stats`."""
    router = APIRouter(tags=["operation"])

    @router.get("/stats")
    async def stats() -> Stats:
        """The service at a glance, at most a second old."""
        return await panel.stats()

    return router
