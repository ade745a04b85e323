"""The pre-annotated spots, ready to be asked what lies where."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.ground import CELL_M
from autowaze.world.parking import ParkingMap

_CODE_SHIFT = 32
MARGIN_M = 0.35
"""Along the edges of a spot the ground says little: a car may be off that far, and vehicles next door lean over."""


class SpotRaster(NamedTuple):
    """The ground cells of one spot.

    Attributes:
        codes: (C,) int64 ascending, `cell_codes` of the cells whose centres lie in the spot.
        centre: (C, 2) float64, their centres in map metres.
        core: (C,) bool, those that lie off its edges by the margin.
    """

    codes: NDArray[np.int64]
    centre: NDArray[np.float64]
    core: NDArray[np.bool_]


class SpotIndex:
    """Spots with an R-tree over them; spots are named by their row in the parking map.

    Attributes:
        ids: the spots' ids.
        polygons: (S,) shapely polygons in map metres.
        centre: (S, 2) metres.
        length, width: (S,) metres, sides of the smallest rectangle around each spot.
        heading: (S,) compass heading of the longer side in radians: how a vehicle stands in it.
        tree: R-tree over `polygons`.
    """

    def __init__(self, parking_map: ParkingMap) -> None:
        self.ids = tuple(spot.id for spot in parking_map.spots)
        self.polygons = np.array([spot.polygon for spot in parking_map.spots], dtype=np.object_)
        self.tree = shapely.STRtree(self.polygons)
        self.centre = np.column_stack([shapely.get_x(c := shapely.centroid(self.polygons)), shapely.get_y(c)])
        corners = np.stack([ring[:4] for ring in _rectangles(self.polygons)]).reshape(-1, 4, 2)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]
        sides = np.stack([np.hypot(*first.T), np.hypot(*second.T)])
        self.length, self.width = sides.max(axis=0), sides.min(axis=0)
        longer = np.where((sides[0] >= sides[1])[:, None], first, second)
        self.heading = np.arctan2(longer[:, 0], longer[:, 1]) % np.pi
        self.raster = cache(self._raster)

    def __len__(self) -> int:
        return len(self.ids)

    def overlapping(self, polygons: NDArray[np.object_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs (polygon, spot) whose interiors or edges meet, sorted."""
        pairs = self.tree.query(polygons, predicate="intersects")
        order = np.lexsort((pairs[1], pairs[0]))
        return pairs[0][order], pairs[1][order]

    def touching(self, low: NDArray[np.floating], high: NDArray[np.floating]) -> NDArray[np.int64]:
        """Spots (N,) that rectangles with these corners (M, 2) touch, sorted, each once."""
        rectangles = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
        return np.unique(self.tree.query(rectangles, predicate="intersects")[1])

    def near(self, points: NDArray[np.float64], within_m: float) -> NDArray[np.bool_]:
        """Whether each point (N, 2) lies within reach of a spot."""
        close = np.zeros(len(points), np.bool_)
        close[self.tree.query(shapely.points(points), predicate="dwithin", distance=within_m)[0]] = True
        return close

    def nearest(self, points: NDArray[np.float64], within_m: float) -> NDArray[np.int64]:
        """Spot (N,) nearest to each point (N, 2), -1 if none is within reach."""
        found = np.full(len(points), -1, np.int64)
        (row, spot), distance = self.tree.query_nearest(
            shapely.points(points), max_distance=within_m, return_distance=True
        )
        order = np.lexsort((spot, distance, row))[::-1]  # of equally near spots the first one is written last
        found[row[order]] = spot[order]
        return found

    def _raster(self, spot: int) -> SpotRaster:
        x0, y0, x1, y1 = np.floor(np.array(self.polygons[spot].bounds) / CELL_M).astype(np.int64)
        ix, iy = (axis.ravel() for axis in np.meshgrid(np.arange(x0, x1 + 1), np.arange(y0, y1 + 1), indexing="xy"))
        x, y = (ix + 0.5) * CELL_M, (iy + 0.5) * CELL_M
        inside = shapely.contains_xy(self.polygons[spot], x, y)
        core = shapely.contains_xy(shapely.buffer(self.polygons[spot], -MARGIN_M), x[inside], y[inside])
        centre = np.stack([x[inside], y[inside]], axis=1)
        return SpotRaster(cell_codes(ix[inside], iy[inside]), centre, core if core.any() else np.ones_like(core))


def cell_codes(ix: NDArray[np.integer], iy: NDArray[np.integer]) -> NDArray[np.int64]:
    """One number (N,) per ground cell, ascending in the order in which cells come over the wire: by iy, then ix."""
    return (np.asarray(iy, dtype=np.int64) << _CODE_SHIFT) + np.asarray(ix, dtype=np.int64)


def _rectangles(polygons: NDArray[np.object_]) -> list[NDArray[np.float64]]:
    return [shapely.get_coordinates(p) for p in shapely.minimum_rotated_rectangle(polygons)]
