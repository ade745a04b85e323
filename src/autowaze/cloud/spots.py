"""The pre-annotated spots, ready to be asked what lies where."""

from __future__ import annotations

import hashlib
from typing import Any, NamedTuple, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.cloud.spot_grid import SpotGrid, raster_of_ring
from autowaze.world.parking import ParkingMap, ParkingSpot
from autowaze.world.spot_shapes import measured

_CODE_SHIFT = 32
_Item = TypeVar("_Item")
MARGIN_M = 0.35
"""Along the edges of a spot the ground says little: a car may be off that far, and vehicles next door lean over."""


class SpotRaster(NamedTuple):
    """The ground cells of one spot.

    Attributes:
        codes: (C,) int64 ascending, `cell_codes` of the cells whose centres lie in the spot.
        core: (C,) bool, those that lie off its edges by the margin; all where the spot is too narrow for that.
    """

    codes: NDArray[np.int64]
    core: NDArray[np.bool_]


class SpotIndex:
    """Spots with an R-tree over them; spots are named by their row.

    Attributes:
        georeference: origin of the map frame.
        ids, kinds: of the spots, by row.
        row_of: row of each id.
        polygons: (S,) shapely polygons in map metres.
        bounds: (S, 4) metres, x0, y0, x1, y1.
        centre: (S, 2) metres.
        length, width: (S,) metres, sides of the smallest rectangle around each spot.
        heading: (S,) compass heading of the longer side in radians: how a vehicle stands in it.
        edition: counts the times that a spot was drawn or erased.
    """

    def __init__(self, parking_map: ParkingMap) -> None:
        self.georeference = parking_map.georeference
        self.survey_heading_rad = parking_map.survey_heading_rad
        self.ids = [spot.id for spot in parking_map.spots]
        self.kinds = [spot.kind for spot in parking_map.spots]
        self.row_of = {spot_id: row for row, spot_id in enumerate(self.ids)}
        self.polygons = np.array([spot.polygon for spot in parking_map.spots], dtype=np.object_)
        self.bounds, self.centre, self.length, self.width, self.heading = measured(self.polygons)
        self._rasters: dict[int, SpotRaster] = {}
        self._tree: shapely.STRtree | None = None
        self._grid: SpotGrid | None = None
        self._fingerprints: list[str] | None = None
        self.edition = 0

    @property
    def tree(self) -> shapely.STRtree:
        """R-tree over `polygons`."""
        if self._tree is None:
            self._tree = shapely.STRtree(self.polygons)
        return self._tree

    @property
    def grid(self) -> SpotGrid:
        """The same outlines, for the few boxes and points of a diff."""
        if self._grid is None:
            self._grid = SpotGrid(self.polygons, self.bounds)
        return self._grid

    @property
    def parking_map(self) -> ParkingMap:
        """The spots as a parking map."""
        spots = zip(self.ids, self.polygons.tolist(), self.kinds, strict=True)
        return ParkingMap(tuple(ParkingSpot(*spot) for spot in spots), self.georeference, self.survey_heading_rad)

    def draw(self, spot: ParkingSpot) -> int:
        """Put a spot in the place of the one with its id, else after all others; returns its row."""
        row = self.row_of.setdefault(spot.id, len(self.ids))
        columns = self._columns()
        if row == len(self.ids):
            self.ids.append(spot.id)
            self.kinds.append(spot.kind)
            columns = [np.concatenate([column, column[:1]]) for column in columns]
        else:
            columns = [column.copy() for column in columns]
        polygon = np.array([spot.polygon], dtype=np.object_)
        for column, value in zip(columns, (polygon, *measured(polygon)), strict=True):
            column[row] = value[0]
        self.kinds[row] = spot.kind
        self._rasters.pop(row, None)
        self._adopt(columns)
        return row

    def erase(self, spot_id: str) -> int:
        """Take a spot away; returns the row that it had. Later ones move up by one."""
        row = self.row_of[spot_id]
        del self.ids[row], self.kinds[row]
        self.row_of = {spot_id: row for row, spot_id in enumerate(self.ids)}
        self._rasters = without_row(self._rasters, row)
        self._adopt([np.delete(column, row, axis=0) for column in self._columns()])
        return row

    def _columns(self) -> list[NDArray[Any]]:
        return [self.polygons, self.bounds, self.centre, self.length, self.width, self.heading]

    def _adopt(self, columns: list[NDArray[Any]]) -> None:
        self.polygons, self.bounds, self.centre, self.length, self.width, self.heading = columns
        self._tree = self._grid = None
        self._fingerprints = None
        self.edition += 1

    def raster(self, spot: int) -> SpotRaster:
        """The ground cells of a spot."""
        if spot not in self._rasters:
            self._rasters[spot] = raster_of(self.polygons[spot])
        return self._rasters[spot]

    def around(self, bounds: NDArray[np.float64]) -> NDArray[np.int64]:
        """Spots (N,) whose bounds meet a rectangle (4,), sorted; needs no tree."""
        low, high = self.bounds[:, :2], self.bounds[:, 2:]
        return np.flatnonzero((low <= bounds[2:]).all(axis=1) & (high >= bounds[:2]).all(axis=1))

    def fingerprints(self) -> list[str]:
        """What tells each spot from all others and from itself elsewhere."""
        if self._fingerprints is None:
            outlines = shapely.to_wkb(self.polygons).tolist()
            self._fingerprints = [
                f"{spot_id} {hashlib.blake2b(outline, digest_size=8).hexdigest()}"
                for spot_id, outline in zip(self.ids, outlines, strict=True)
            ]
        return self._fingerprints

    def __len__(self) -> int:
        return len(self.ids)

    def overlapping(self, polygons: NDArray[np.object_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs (polygon, spot) whose interiors or edges meet, sorted."""
        pairs = self.tree.query(polygons, predicate="intersects")
        order = np.lexsort((pairs[1], pairs[0]))
        return pairs[0][order], pairs[1][order]

    def near(self, points: NDArray[np.float64], within_m: float) -> NDArray[np.bool_]:
        """Whether each point (N, 2) lies within reach of a spot."""
        close = np.zeros(len(points), np.bool_)
        close[self.tree.query(shapely.points(points), predicate="dwithin", distance=within_m)[0]] = True
        return close


def raster_of(polygon: shapely.Polygon) -> SpotRaster:
    """The ground cells of an outline in map metres."""
    cells, core = raster_of_ring(shapely.get_coordinates(polygon), MARGIN_M)
    return SpotRaster(cell_codes(cells[:, 0], cells[:, 1]), core if core.any() else np.ones_like(core))


def without_row(items: dict[int, _Item], gone: int) -> dict[int, _Item]:
    """Items by row after one row went and the later ones moved up."""
    return {row - (row > gone): item for row, item in items.items() if row != gone}


def cell_codes(ix: NDArray[np.integer], iy: NDArray[np.integer]) -> NDArray[np.int64]:
    """One number (N,) per ground cell, ascending in the order in which cells come over the wire: by iy, then ix."""
    return (np.asarray(iy, dtype=np.int64) << _CODE_SHIFT) + np.asarray(ix, dtype=np.int64)
