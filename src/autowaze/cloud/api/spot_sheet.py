"""Where the spots lie, worked out once for each state of the parking map and never changed after."""

from __future__ import annotations

import copy
import json
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.cloud.api.zones import Kerb
from autowaze.cloud.occupancy import vacant_rectangles
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap, ParkingSpot

Rectangle = dict[str, float]


class SpotSheet:
    """Columns of a parking map, by row; a drawn or erased spot makes another sheet.

    Attributes:
        georeference: origin of the map frame.
        ids, kinds: of the spots.
        rectangles: {x, y, width, height} in map metres around each spot.
        polygons: (S,) outlines in map metres.
        outlines_lon_lat: (S,) polygons, counter-clockwise.
        bounds_lon_lat: (S, 4) west, south, east, north.
    """

    def __init__(self, parking_map: ParkingMap) -> None:
        self.georeference: Georeference = parking_map.georeference
        self.survey_heading_rad = parking_map.survey_heading_rad
        self.ids = [spot.id for spot in parking_map.spots]
        self.kinds = [spot.kind for spot in parking_map.spots]
        self.polygons = np.array([spot.polygon for spot in parking_map.spots], dtype=np.object_)
        self.rectangles: list[Rectangle] = vacant_rectangles(self.polygons)
        outlines = shapely.transform(self.polygons, parking_map.georeference.to_lon_lat)
        self.outlines_lon_lat = shapely.force_2d(np.asarray(shapely.orient_polygons(outlines), dtype=np.object_))
        self.bounds_lon_lat: NDArray[np.float64] = shapely.bounds(self.outlines_lon_lat)

    @cached_property
    def geometries(self) -> list[Any]:
        """Outlines as GeoJSON, to a centimetre: RFC 7946, sec. 11.2 asks for no more digits than are meant."""
        rounded = shapely.transform(self.outlines_lon_lat, lambda lon_lat: np.round(lon_lat, 7))
        return [json.loads(text) for text in shapely.to_geojson(rounded)]

    @cached_property
    def kerb(self) -> Kerb:
        """The spots as CDS has them; takes seconds for a city."""
        return Kerb(self.parking_map)

    def survey(self) -> None:
        """Work out now what takes long, so that nobody who asks has to wait for it."""
        _ = self.geometries, self.kerb

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def row_of(self) -> dict[str, int]:
        """Row of each id."""
        return {spot_id: row for row, spot_id in enumerate(self.ids)}

    @cached_property
    def tree(self) -> shapely.STRtree:
        """R-tree over `outlines_lon_lat`."""
        return shapely.STRtree(self.outlines_lon_lat)

    @property
    def parking_map(self) -> ParkingMap:
        """The spots as a parking map."""
        spots = zip(self.ids, self.polygons.tolist(), self.kinds, strict=True)
        return ParkingMap(tuple(ParkingSpot(*spot) for spot in spots), self.georeference, self.survey_heading_rad)

    def with_spot(self, spot: ParkingSpot) -> SpotSheet:
        """A sheet with this spot in the place of the one with its id, else after all others."""
        drawn = SpotSheet(ParkingMap((spot,), self.georeference))
        return self._spliced(self.row_of.get(spot.id, len(self)), drawn)

    def without_spot(self, spot_id: str) -> SpotSheet:
        """A sheet without the spot of this id."""
        return self._spliced(self.row_of[spot_id], None)

    def _spliced(self, row: int, drawn: SpotSheet | None) -> SpotSheet:
        sheet = copy.copy(self)
        for derived in ("row_of", "tree"):
            sheet.__dict__.pop(derived, None)
        lists = ("ids", "kinds", "rectangles", *(["geometries"] if "geometries" in self.__dict__ else []))
        for column in lists:
            items = getattr(self, column)
            setattr(sheet, column, items[:row] + (getattr(drawn, column) if drawn else []) + items[row + 1 :])
        for column in ("polygons", "outlines_lon_lat", "bounds_lon_lat"):
            values = getattr(self, column)
            middle = [getattr(drawn, column)] if drawn else []
            setattr(sheet, column, np.concatenate([values[:row], *middle, values[row + 1 :]]))
        if "kerb" in self.__dict__:
            sheet.kerb = self.kerb.spliced(row, drawn.kerb if drawn else None)
        return sheet
