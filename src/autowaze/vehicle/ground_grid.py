"""The ground that a car saw: votes of its frames, what they come to, and when that is told."""

from __future__ import annotations

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.vehicle.ground import GroundObservation
from autowaze.world.ground import GroundCells
from autowaze.world.parking import ParkingMap
from autowaze.world.raster_codec import BLOCK, MAX_SEEN_SQUARES, MAX_SQUARES

REACH_M = 0.5
"""Ground so near to a spot is told of: a spot may be drawn, and a car localised, that far off."""
PASSED_M = 4.0
"""Ground so little ahead of a camera has left its view, or is about to."""
HELD_WINDOWS = 2
"""Ground ahead is told of when so many more windows have ended, if the car has not passed it by then."""
_AROUND = (5, 5)
_MOST_UNCOUNTED = 8
_MOST_CELLS_ACROSS = BLOCK * int(np.sqrt(MAX_SQUARES))


class GroundGrid:
    """Votes of frames since they were told of last.

    Args:
        area: where anybody wants to know of the ground, map metres; None for everywhere.
    """

    def __init__(self, area: shapely.Geometry | None = None) -> None:
        self.area = area
        self._cells = GroundCells.empty()
        self._windows = np.zeros(0, np.int64)
        self._frames: list[GroundCells] = []

    def add(self, observation: GroundObservation) -> None:
        """Count one frame's cells."""
        free, obstacle = observation.free.astype(np.uint16), observation.obstacle.astype(np.uint16)
        self._frames.append(GroundCells(observation.ix, observation.iy, free, obstacle))
        if len(self._frames) >= _MOST_UNCOUNTED:
            self._count()

    def tell(self, position: NDArray[np.float64], heading: float) -> GroundCells:
        """As `classes`, of what lies beside and behind a car; what lies ahead waits until it has been passed.

        The car sees it again from nearer, and then tells of it once and better. Nothing waits longer than for the ends
        of two more windows. What is told of is forgotten.

        Args:
            position: (2,) of the car at the end of a window, map metres.
            heading: where it looks, clockwise from north, radians.
        """
        classes = self.classes()
        forward = np.array([np.sin(heading), np.cos(heading)])
        waits = ((self._cells.centre - position) @ forward > PASSED_M) & (self._windows < HELD_WINDOWS)
        told = ~np.isin(_keys(classes), _keys(self._cells[waits]))
        self._cells, self._windows = self._cells[waits], self._windows[waits] + 1
        return classes[told]

    def forget(self) -> None:
        """Take back all that was not told."""
        self._cells, self._windows, self._frames = GroundCells.empty(), np.zeros(0, np.int64), []

    def cells(self) -> GroundCells:
        """Votes so far, sorted by ix, then iy."""
        self._count()
        return self._cells

    def classes(self) -> GroundCells:
        """One vote per cell of the area: what most of the 5 by 5 cells around it were to most frames.

        A few cells that differ from all around them are noise of stereo, and noise is what costs bytes.
        """
        cells = self.cells()
        if len(cells) == 0:
            return cells
        x, y = int(cells.ix.min()), int(cells.iy.min())
        shape = int(cells.iy.max()) - y + 1, int(cells.ix.max()) - x + 1
        if max(shape) > _MOST_CELLS_ACROSS - 2 * BLOCK:
            cells = _around_the_middle(cells)
            x, y = int(cells.ix.min()), int(cells.iy.min())
            shape = int(cells.iy.max()) - y + 1, int(cells.ix.max()) - x + 1
        grid = np.zeros(shape, np.uint8)
        grid[cells.iy - y, cells.ix - x] = np.where(cells.obstacle >= np.maximum(cells.free, 1), 2, 1)
        unseen, free, obstacle = (
            cv2.boxFilter((grid == k).astype(np.uint8), -1, _AROUND, normalize=False) for k in range(3)
        )
        stands = obstacle > np.maximum(unseen, free)
        iy, ix = np.nonzero(stands | (free > unseen))
        is_obstacle = stands[iy, ix]
        votes = (~is_obstacle).astype(np.uint16), is_obstacle.astype(np.uint16)
        classed = GroundCells((ix + x).astype(np.int32), (iy + y).astype(np.int32), *votes)
        if self.area is not None:
            classed = classed[np.asarray(shapely.contains_xy(self.area, *classed.centre.T))]
        return _within_the_limit(classed)

    def _count(self) -> None:
        if not self._frames:
            return
        before, windows = self._cells, self._windows
        self._cells = _merge(GroundCells.concatenate([before, *self._frames]))
        self._windows = np.zeros(len(self._cells), np.int64)
        self._windows[np.searchsorted(_keys(self._cells), _keys(before))] = windows
        self._frames = []


def ground_that_matters(spots: ParkingMap) -> shapely.Geometry:
    """The spots of a parking map and what lies within reach of them, map metres, ready for many questions."""
    area = shapely.union_all(shapely.buffer(np.array([spot.polygon for spot in spots.spots], np.object_), REACH_M))
    shapely.prepare(area)
    return area


def _keys(cells: GroundCells) -> NDArray[np.int64]:
    """One number (N,) per cell, ascending by ix, then iy."""
    return (cells.ix.astype(np.int64) << 32) + cells.iy


def _merge(cells: GroundCells) -> GroundCells:
    """One row per cell, votes added."""
    key = _keys(cells)
    unique, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    free = np.bincount(inverse, cells.free, len(unique)).astype(np.uint16)
    obstacle = np.bincount(inverse, cells.obstacle, len(unique)).astype(np.uint16)
    return GroundCells(cells.ix[first], cells.iy[first], free, obstacle)


def _around_the_middle(cells: GroundCells) -> GroundCells:
    """Cells of a window that spans too much, no farther from its middle than a message tells."""
    reach = _MOST_CELLS_ACROSS // 2 - BLOCK
    near = (np.abs(cells.ix - np.median(cells.ix)) < reach) & (np.abs(cells.iy - np.median(cells.iy)) < reach)
    return cells[near]


def _within_the_limit(cells: GroundCells) -> GroundCells:
    """All cells, or of too many squares those with the most."""
    square = _squares(cells)
    unique, row, count = np.unique(square, return_inverse=True, return_counts=True)
    if len(unique) <= MAX_SEEN_SQUARES:
        return cells
    kept = np.zeros(len(unique), np.bool_)
    kept[np.argsort(-count, kind="stable")[:MAX_SEEN_SQUARES]] = True
    return cells[kept[row]]


def _squares(cells: GroundCells) -> NDArray[np.int64]:
    return (cells.iy.astype(np.int64) // BLOCK << 32) + cells.ix // BLOCK
