"""Spots by place, compiled: the same questions come with every diff, a few boxes and points at a time.

An R-tree answers each of them in tens of microseconds before it has looked at anything; here outlines lie in plain
arrays, filed under the cells of a grid. Outlines are simple rings without holes, as parking maps have them.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.cloud.cell_kernels import blocks_of_cells
from autowaze.cloud.clipping import clipped_area_m2
from autowaze.world.ground import CELL_M

_BLOCK_BITS = 6
_CELL_M = CELL_M * (1 << _BLOCK_BITS)
_SHIFT = 32


class SpotGrid:
    """Outlines (S,) in map metres, to be asked what lies where; spots are named by their row."""

    def __init__(self, polygons: NDArray[np.object_], bounds: NDArray[np.float64]) -> None:
        self._corners, owner = shapely.get_coordinates(polygons, return_index=True)
        self._starts = np.searchsorted(owner, np.arange(len(polygons) + 1)).astype(np.int64)
        self._bounds = np.ascontiguousarray(bounds, dtype=np.float64).reshape(-1, 4)
        self._codes, self._cell_starts, self._spots = _filed(self._bounds)

    def around_cells(self, ix: NDArray[np.int32], iy: NDArray[np.int32]) -> NDArray[np.int64]:
        """Spots (N,) whose bounds touch the blocks of 16 m that hold ground cells (M,), sorted, each once."""
        return _touching(
            blocks_of_cells(ix, iy, _BLOCK_BITS), self._bounds, self._codes, self._cell_starts, self._spots
        )

    def overlaps(
        self, corners: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Boxes and spots (P,) that have an area in common, sorted by box, then spot, and that area in m2.

        Args:
            corners: (B, 4, 2) of convex boxes, counter-clockwise or clockwise.
        """
        return _overlaps(
            corners, self._corners, self._starts, self._bounds, self._codes, self._cell_starts, self._spots
        )

    def nearest(self, points: NDArray[np.float64], within_m: float) -> NDArray[np.int64]:
        """Spot (N,) nearest to each point (N, 2), the first of equally near ones, -1 if none is within reach."""
        return _nearest(
            points, within_m, self._corners, self._starts, self._bounds, self._codes, self._cell_starts, self._spots
        )


def _filed(bounds: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Codes of the grid's cells that spots with these bounds touch, ascending; where each cell begins; the spots."""
    low, high = (np.floor(part / _CELL_M).astype(np.int64) for part in (bounds[:, :2], bounds[:, 2:]))
    wide, tall = (high - low + 1).T if len(bounds) else (np.zeros(0, np.int64),) * 2
    spot = np.repeat(np.arange(len(bounds)), wide * tall)
    number = np.arange(len(spot)) - np.repeat(np.cumsum(wide * tall) - wide * tall, wide * tall)
    x, y = low[spot, 0] + number % wide[spot], low[spot, 1] + number // wide[spot]
    code = (y << _SHIFT) + x
    order = np.argsort(code, kind="stable")
    codes, starts = np.unique(code[order], return_index=True)
    return codes, np.append(starts, len(spot)), spot[order]


@numba.njit(cache=True, nogil=True)
def raster_of_ring(ring: NDArray[np.float64], margin_m: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Ground cells (C, 2) x, y whose centres lie in a ring (K, 2), by y, then x; and which lie off it by a margin."""
    x0, y0 = math.floor(ring[:, 0].min() / CELL_M), math.floor(ring[:, 1].min() / CELL_M)
    x1, y1 = math.floor(ring[:, 0].max() / CELL_M), math.floor(ring[:, 1].max() / CELL_M)
    cells = np.empty(((x1 - x0 + 1) * (y1 - y0 + 1), 2), np.int64)
    core = np.empty(len(cells), np.bool_)
    count = 0
    for iy in range(y0, y1 + 1):
        for ix in range(x0, x1 + 1):
            inside, distance2 = _place((ix + 0.5) * CELL_M, (iy + 0.5) * CELL_M, ring, 0, len(ring))
            if inside and distance2 > 0.0:
                cells[count, 0], cells[count, 1] = ix, iy
                core[count] = distance2 > margin_m * margin_m
                count += 1
    return cells[:count], core[:count]


@numba.njit(cache=True, nogil=True)
def cells_in_reach(codes: NDArray[np.int64], box: NDArray[np.float64], rim_m: float) -> NDArray[np.bool_]:
    """Which ground cells (C,), `spots.cell_codes`, have their centres in a box (4, 2) or not farther from it."""
    found = np.empty(len(codes), np.bool_)
    for row in range(len(codes)):
        iy = (codes[row] + (1 << (_SHIFT - 1))) >> _SHIFT
        ix = codes[row] - (iy << _SHIFT)
        inside, distance2 = _place((ix + 0.5) * CELL_M, (iy + 0.5) * CELL_M, box, 0, len(box))
        found[row] = inside or distance2 <= rim_m * rim_m
    return found


@numba.njit(cache=True, nogil=True)
def _touching(
    blocks: NDArray[np.int64],
    bounds: NDArray[np.float64],
    codes: NDArray[np.int64],
    starts: NDArray[np.int64],
    spots: NDArray[np.int64],
) -> NDArray[np.int64]:
    found = np.empty(64, np.int64)
    count = 0
    for block in range(len(blocks)):
        low_x, low_y = blocks[block, 0] * _CELL_M, blocks[block, 1] * _CELL_M
        # A spot that begins on the far edge of a block touches it, and is filed under the next cell.
        for y in range(blocks[block, 1], blocks[block, 1] + 2):
            for x in range(blocks[block, 0], blocks[block, 0] + 2):
                cell = _cell(codes, (y << _SHIFT) + x)
                if cell < 0:
                    continue
                for row in range(starts[cell], starts[cell + 1]):
                    spot = spots[row]
                    if (
                        bounds[spot, 0] > low_x + _CELL_M
                        or bounds[spot, 2] < low_x
                        or bounds[spot, 1] > low_y + _CELL_M
                        or bounds[spot, 3] < low_y
                    ):
                        continue
                    if count == len(found):
                        found = np.append(found, np.empty(count, np.int64))
                    found[count] = spot
                    count += 1
    return np.unique(found[:count])


@numba.njit(cache=True, nogil=True)
def _overlaps(
    corners: NDArray[np.float64],
    ring: NDArray[np.float64],
    ring_starts: NDArray[np.int64],
    bounds: NDArray[np.float64],
    codes: NDArray[np.int64],
    starts: NDArray[np.int64],
    spots: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    pairs, areas = np.empty((16, 2), np.int64), np.empty(16)
    count = 0
    for box in range(len(corners)):
        first = count
        x0, y0 = corners[box, :, 0].min(), corners[box, :, 1].min()
        x1, y1 = corners[box, :, 0].max(), corners[box, :, 1].max()
        cell_x, cell_y = math.floor(x0 / _CELL_M), math.floor(y0 / _CELL_M)
        for y in range(cell_y, math.floor(y1 / _CELL_M) + 1):
            for x in range(cell_x, math.floor(x1 / _CELL_M) + 1):
                cell = _cell(codes, (y << _SHIFT) + x)
                if cell < 0:
                    continue
                for row in range(starts[cell], starts[cell + 1]):
                    spot = spots[row]
                    if bounds[spot, 0] > x1 or bounds[spot, 2] < x0 or bounds[spot, 1] > y1 or bounds[spot, 3] < y0:
                        continue
                    # Both are in several cells: the pair counts in the first one that they share.
                    if x != max(cell_x, math.floor(bounds[spot, 0] / _CELL_M)):
                        continue
                    if y != max(cell_y, math.floor(bounds[spot, 1] / _CELL_M)):
                        continue
                    area = clipped_area_m2(ring[ring_starts[spot] : ring_starts[spot + 1]], corners[box])
                    if area <= 0.0:
                        continue
                    if count == len(areas):
                        pairs = np.concatenate((pairs, np.empty_like(pairs)))
                        areas = np.append(areas, np.empty(count))
                    place = count
                    while place > first and pairs[place - 1, 1] > spot:
                        pairs[place], areas[place] = pairs[place - 1], areas[place - 1]
                        place -= 1
                    pairs[place, 0], pairs[place, 1], areas[place] = box, spot, area
                    count += 1
    return pairs[:count, 0].copy(), pairs[:count, 1].copy(), areas[:count].copy()


@numba.njit(cache=True, nogil=True)
def _nearest(
    points: NDArray[np.float64],
    within_m: float,
    ring: NDArray[np.float64],
    ring_starts: NDArray[np.int64],
    bounds: NDArray[np.float64],
    codes: NDArray[np.int64],
    starts: NDArray[np.int64],
    spots: NDArray[np.int64],
) -> NDArray[np.int64]:
    found = np.full(len(points), -1, np.int64)
    for number in range(len(points)):
        px, py = points[number]
        best = within_m * within_m
        for y in range(math.floor((py - within_m) / _CELL_M), math.floor((py + within_m) / _CELL_M) + 1):
            for x in range(math.floor((px - within_m) / _CELL_M), math.floor((px + within_m) / _CELL_M) + 1):
                cell = _cell(codes, (y << _SHIFT) + x)
                if cell < 0:
                    continue
                for row in range(starts[cell], starts[cell + 1]):
                    spot = spots[row]
                    away_x = max(bounds[spot, 0] - px, px - bounds[spot, 2], 0.0)
                    away_y = max(bounds[spot, 1] - py, py - bounds[spot, 3], 0.0)
                    if away_x * away_x + away_y * away_y > best:
                        continue
                    inside, distance2 = _place(px, py, ring, ring_starts[spot], ring_starts[spot + 1])
                    if inside:
                        distance2 = 0.0
                    if distance2 < best or (distance2 == best and (found[number] < 0 or spot < found[number])):
                        best, found[number] = distance2, spot
    return found


@numba.njit(cache=True, nogil=True)
def _cell(codes: NDArray[np.int64], code: int) -> int:
    """Row of a cell, -1 if nothing is filed under it."""
    low, high = 0, len(codes)
    while low < high:
        middle = (low + high) // 2
        if codes[middle] < code:
            low = middle + 1
        else:
            high = middle
    return low if low < len(codes) and codes[low] == code else -1


@numba.njit(cache=True, nogil=True)
def _place(x: float, y: float, ring: NDArray[np.float64], first: int, end: int) -> tuple[bool, float]:
    """Whether a point lies in a ring, rows first to end of corners, and its squared distance to the ring's edges."""
    inside, nearest2 = False, np.inf
    before = end - 1
    for row in range(first, end):
        ax, ay, bx, by = ring[before, 0], ring[before, 1], ring[row, 0], ring[row, 1]
        before = row
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
        step_x, step_y = bx - ax, by - ay
        length2 = step_x * step_x + step_y * step_y
        if length2 == 0.0:
            continue
        share = min(max(((x - ax) * step_x + (y - ay) * step_y) / length2, 0.0), 1.0)
        away_x, away_y = ax + share * step_x - x, ay + share * step_y - y
        nearest2 = min(nearest2, away_x * away_x + away_y * away_y)
    return inside, nearest2
