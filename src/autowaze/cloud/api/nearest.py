"""Where to park: the vacant spots near a point, with the way to each and the chance that it is free on arrival."""

from __future__ import annotations

import asyncio
import threading
from http import HTTPStatus
from typing import Annotated, Literal

import numpy as np
import shapely
from fastapi import APIRouter, Query
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from autowaze.cloud.api.problems import problems
from autowaze.cloud.api.spot_book import BelievedSpots, SpotBook
from autowaze.cloud.api.spot_sheet import SpotSheet
from autowaze.cloud.nearest import Choice, SpotFinder, SpotPlaces
from autowaze.cloud.routing import TravelMode

MOST_SPOTS = 50


class Route(BaseModel):
    """A GeoJSON line (RFC 7946), lon/lat."""

    type: Literal["LineString"] = "LineString"
    coordinates: list[tuple[float, float]]


class NearSpot(BaseModel):
    """A spot that is likely vacant, and the way to it."""

    spot_id: str
    lon: float
    lat: float
    distance_m: float
    duration_s: float
    probability_vacant: float = Field(ge=0, le=1, description="Now.")
    probability_on_arrival: float = Field(ge=0, le=1, description="That it is still vacant when one gets there.")
    expected_s: float = Field(description="Until one has parked, here or elsewhere: what spots are ranked by.")
    observed_at: float | None = Field(description="When a car last saw it, seconds since the epoch (UTC).")
    route: Route


class NearSpots(BaseModel):
    """The best spots first."""

    spots: list[NearSpot]
    routed: bool = Field(description="Along streets; else as the crow flies.")


class ParkingGuide:
    """Answers where to park.

    Args:
        book: the spots and what is believed of them.
        finder: knows the streets.
    """

    def __init__(self, book: SpotBook, finder: SpotFinder) -> None:
        self._book = book
        self._finder = finder
        self._placing = threading.Lock()
        self._placed: tuple[SpotSheet, SpotPlaces] | None = None
        self._places_of(book.sheet)

    async def near(self, lon: float, lat: float, mode: TravelMode, limit: int) -> NearSpots:
        """The best spots for who is at a point, in degrees."""
        believed = await self._book.believed()
        return await asyncio.to_thread(self._near, believed, lon, lat, mode, limit)

    def _near(self, believed: BelievedSpots, lon: float, lat: float, mode: TravelMode, limit: int) -> NearSpots:
        sheet = believed.sheet
        point = sheet.georeference.to_map(np.array([[lon, lat]]))[0, :2]
        routed, choices = self._finder.nearest(
            point, mode, limit, self._places_of(sheet), believed.states.probabilities
        )
        return NearSpots(spots=[_described(choice, believed) for choice in choices], routed=routed)

    def _places_of(self, sheet: SpotSheet) -> SpotPlaces:
        with self._placing:
            if self._placed is None or self._placed[0] is not sheet:
                self._placed = sheet, self._finder.place(_centres(sheet))
            return self._placed[1]


def nearest_routes(guide: ParkingGuide) -> APIRouter:
    """`/nearest`."""
    router = APIRouter(tags=["spots"])

    @router.get("/nearest", responses=problems(HTTPStatus.BAD_REQUEST))
    async def nearest(
        lon: Annotated[float, Query(ge=-180, le=180, allow_inf_nan=False, description="Degrees.")],
        lat: Annotated[float, Query(ge=-90, le=90, allow_inf_nan=False, description="Degrees.")],
        limit: Annotated[int, Query(ge=1, le=MOST_SPOTS)] = 5,
        mode: TravelMode = TravelMode.WALKING,
    ) -> NearSpots:
        """Vacant spots near a point, those first at which one has most likely parked soonest."""
        return await guide.near(lon, lat, mode, limit)

    return router


def _described(choice: Choice, believed: BelievedSpots) -> NearSpot:
    sheet = believed.sheet
    path = np.round(sheet.georeference.to_lon_lat(choice.path), 7).tolist()
    return NearSpot(
        spot_id=sheet.ids[choice.row],
        lon=path[-1][0],
        lat=path[-1][1],
        distance_m=round(choice.distance_m, 1),
        duration_s=round(choice.duration_s, 1),
        probability_vacant=round(choice.probability_vacant, 4),
        probability_on_arrival=round(choice.probability_on_arrival, 4),
        expected_s=round(choice.expected_s, 1),
        observed_at=believed.states[choice.row].observed_at,
        route=Route(coordinates=path),
    )


def _centres(sheet: SpotSheet) -> NDArray[np.float64]:
    """Middles (S, 2) of the spots in map metres."""
    middle = shapely.centroid(sheet.polygons)
    return np.column_stack([shapely.get_x(middle), shapely.get_y(middle)])
