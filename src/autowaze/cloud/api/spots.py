"""Which spots are free: the thesis's rectangles, and GeoJSON with probability and age."""

from __future__ import annotations

import asyncio
import json
from http import HTTPStatus
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Header, Query, Response
from pydantic import BaseModel, Field

from autowaze.cloud.api.bounding_box import BBOX, box_asked_for
from autowaze.cloud.api.history import LATEST
from autowaze.cloud.api.problems import problems
from autowaze.cloud.api.spot_book import SpotBook
from autowaze.cloud.api.spot_collection import GEOJSON, SpotCollections

__all__ = ["GEOJSON", "RectangleModel", "SpotCollection", "SpotFeature", "json_response", "spot_routes"]

_Moment = Annotated[
    float | None,
    Query(ge=0, le=LATEST, allow_inf_nan=False, description="As believed at this time, seconds since the epoch (UTC)."),
]


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
    map_version: int | None = Field(description="Null for a time in the past.")
    features: list[SpotFeature]


def spot_routes(book: SpotBook, collections: SpotCollections) -> APIRouter:
    """`/vacant` and `/spots.geojson`."""
    router = APIRouter(tags=["spots"])

    @router.get("/vacant", responses={200: {"model": list[RectangleModel]}})
    async def vacant() -> Response:
        """Rectangles of the vacant spots (thesis, sec. 3.3.6)."""
        believed = await book.believed()
        # In a thread: a city's spots take a second, and cars shall not wait for it.
        return json_response(await asyncio.to_thread(book.vacant_rectangles, believed))

    @router.get(
        "/spots.geojson",
        responses={200: {"model": SpotCollection, "content": {GEOJSON: {}}}, **problems(HTTPStatus.BAD_REQUEST)},
    )
    async def spots(
        bbox: BBOX = None,
        at: _Moment = None,
        accept_encoding: Annotated[str, Header(max_length=1000)] = "",
    ) -> Response:
        """Every spot with state, probability, age; now or at a time, all or those that a box touches."""
        box = None if bbox is None else box_asked_for(bbox)
        if at is not None:
            return await collections.at(at, box)
        return await collections.now(box, "gzip" in accept_encoding)

    return router


def json_response(document: object, media_type: str = "application/json") -> Response:
    """A document that is right now and will not be for long."""
    body = json.dumps(document, separators=(",", ":"), allow_nan=False)
    return Response(body, media_type=media_type, headers={"Cache-Control": "no-cache"})
