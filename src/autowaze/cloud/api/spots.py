"""Which spots are free: the thesis's rectangles, and GeoJSON with probability and age."""

from __future__ import annotations

import asyncio
import json
from typing import Any, Literal

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field

from autowaze.cloud.api.spot_book import BelievedSpots, SpotBook

GEOJSON = "application/geo+json"


class RectangleModel(BaseModel):
    """A rectangle in map metres: lower left corner, width (east) and height (north)."""

    x: float
    y: float
    width: float
    height: float


class SpotProperties(BaseModel):
    """What is believed of a spot."""

    spot_id: str
    kind: str
    state: Literal["vacant", "occupied", "unknown"]
    probability: float = Field(ge=0, le=1, description="That it is vacant.")
    observed_at: float | None = Field(description="When a car last saw it, seconds since the epoch (UTC).")
    age_s: float | None = Field(description="Seconds since then.")
    rectangle: RectangleModel


class SpotFeature(BaseModel):
    """A spot (RFC 7946), lon/lat."""

    type: Literal["Feature"]
    id: str
    geometry: dict[str, Any]
    properties: SpotProperties


class SpotCollection(BaseModel):
    """All spots."""

    type: Literal["FeatureCollection"]
    map_version: int
    features: list[SpotFeature]


def spot_routes(book: SpotBook) -> APIRouter:
    """`/vacant` and `/spots.geojson`."""
    router = APIRouter(tags=["spots"])

    @router.get("/vacant", responses={200: {"model": list[RectangleModel]}})
    async def vacant() -> Response:
        """Rectangles of the vacant spots (thesis, sec. 3.3.6)."""
        return json_response(book.vacant_rectangles(await book.believed()))

    @router.get("/spots.geojson", responses={200: {"model": SpotCollection, "content": {GEOJSON: {}}}})
    async def spots() -> Response:
        """Every spot with state, probability, age."""
        # In a thread: a city's spots take a second, and cars shall not wait for it.
        return await asyncio.to_thread(_collection, await book.believed())

    return router


def _collection(believed: BelievedSpots) -> Response:
    features = [believed.feature(row) for row in range(len(believed.sheet))]
    document = {"type": "FeatureCollection", "map_version": believed.version, "features": features}
    return json_response(document, GEOJSON)


def json_response(document: object, media_type: str = "application/json") -> Response:
    """A document that is right now and will not be for long."""
    body = json.dumps(document, separators=(",", ":"), allow_nan=False)
    return Response(body, media_type=media_type, headers={"Cache-Control": "no-cache"})
