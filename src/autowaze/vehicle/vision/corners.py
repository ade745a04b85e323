"""Corners of a pyramid, spread over the image.

The response follows the segment test of FAST (Rosten & Drummond 2006) in a form that needs no branches: on a circle of
radius 3 every pair of opposite pixels must have one that is brighter (or darker) than the centre by the threshold. An
edge fails along its direction, as it does in FAST; the least of those differences is the strength.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.compiled import compiled
from autowaze.vehicle.vision.pyramid import Pyramid
from autowaze.world.columns import Columns

BORDER_PX = 19  # half the descriptor's patch and what its rotation and blur need
_RADIUS_PX = 3  # of the circle: (0, 3), (3, 0), (2, 2), (2, -2) and the pixels opposite
_MAX_RANK = 64  # corners of one cell that compete


@dataclass
class Corners(Columns):
    """Corners of one image, N rows.

    Attributes:
        xy: (N, 2) int64, pixels of their level.
        octave: (N,) uint8, the level.
        peak: (N, 2) float32, where between the pixels the response is highest, pixels of their level.
    """

    xy: NDArray[np.int64]
    octave: NDArray[np.uint8]
    peak: NDArray[np.float32]


class CornerFinder:
    """Finds the corners of some levels and keeps those that cover the image best.

    All intermediate images live in memory taken once: fresh memory for each would cost more than the arithmetic.
    """

    def __init__(self, pyramid: Pyramid, levels: list[int], quota: NDArray[np.int64], threshold: int) -> None:
        self._pyramid = pyramid
        self._levels = levels
        self._quota = quota
        self._threshold = threshold
        largest = max(pyramid.levels[level].size for level in levels)
        self._bytes = np.zeros((2, largest), np.uint8)
        self._words = np.zeros(largest, np.uint16)

    def find(self) -> Corners:
        """Corners of the levels, level by level."""
        return Corners.concatenate([self._find_in_level(level) for level in self._levels])

    def _find_in_level(self, level: int) -> Corners:
        image = self._pyramid.levels[level]
        response, is_peak = (flat[: image.size].reshape(image.shape) for flat in self._bytes)
        strength = self._words[: image.size].reshape(image.shape)
        is_peak[:] = 0
        _find_peaks(image, np.uint8(self._threshold), response, strength, is_peak)
        cell_px = max(np.sqrt(image.size / max(self._quota[level], 1)), 1.0)
        xy = _spread_corners(_places(is_peak.reshape(-1)), strength, cell_px, self._quota[level])
        return Corners(xy, np.full(len(xy), level, np.uint8), _peaks(xy, strength))


@compiled
def _find_peaks(image, threshold, response, strength, is_peak):  # type: ignore[no-untyped-def]
    """Where the response, summed over 3 x 3 pixels, is highest among its neighbours and above the threshold itself.

    Of equally strong neighbours the last one in reading order is taken. Fills response, strength and is_peak (H, W) as
    far as the border; row by row, so that what one step writes is still near when the next one reads it.
    """
    height = image.shape[0]
    first = BORDER_PX - 2
    for y in range(first, height - first):
        _response(image[y - 3], image[y - 2], image[y], image[y + 2], image[y + 3], response[y])
        if y > first + 1:
            _sum_around(response[y - 2], response[y - 1], response[y], strength[y - 1])
        if y > first + 3:
            rows = strength[y - 3], strength[y - 2], strength[y - 1]
            _highest(rows[0], rows[1], rows[2], response[y - 2], threshold, is_peak[y - 2])


@compiled
def _response(up, above, here, below, down, out):  # type: ignore[no-untyped-def]
    """Response of one row (W,) from the rows 3 and 2 above and below it; unsigned indices need no test for the end."""
    for k in range(out.shape[0] - 2 * _RADIUS_PX):
        i = np.uint64(k)
        centre = here[i + np.uint64(3)]
        bright, dark = _ordered(up[i + np.uint64(3)], down[i + np.uint64(3)])
        high, low = _ordered(here[i], here[i + np.uint64(6)])
        bright, dark = _lesser(bright, high), _greater(dark, low)
        high, low = _ordered(above[i + np.uint64(1)], below[i + np.uint64(5)])
        bright, dark = _lesser(bright, high), _greater(dark, low)
        high, low = _ordered(above[i + np.uint64(5)], below[i + np.uint64(1)])
        bright, dark = _lesser(bright, high), _greater(dark, low)
        brighter = np.uint8(bright - centre) if bright > centre else np.uint8(0)
        darker = np.uint8(centre - dark) if centre > dark else np.uint8(0)
        out[i + np.uint64(3)] = _greater(brighter, darker)


@compiled
def _sum_around(above, here, below, out):  # type: ignore[no-untyped-def]
    for k in range(out.shape[0] - 2):
        i, j, m = np.uint64(k), np.uint64(k + 1), np.uint64(k + 2)
        upper = np.uint16(np.uint16(above[i]) + np.uint16(np.uint16(above[j]) + np.uint16(above[m])))
        middle = np.uint16(np.uint16(here[i]) + np.uint16(np.uint16(here[j]) + np.uint16(here[m])))
        lower = np.uint16(np.uint16(below[i]) + np.uint16(np.uint16(below[j]) + np.uint16(below[m])))
        out[j] = np.uint16(upper + np.uint16(middle + lower))


@compiled
def _highest(above, here, below, response, threshold, out):  # type: ignore[no-untyped-def]
    for k in range(out.shape[0] - 2):
        i, j, m = np.uint64(k), np.uint64(k + 1), np.uint64(k + 2)
        before = _greater(_greater(above[i], above[j]), _greater(above[m], here[i]))
        after = _greater(_greater(below[i], below[j]), _greater(below[m], here[m]))
        out[j] = np.uint8((here[j] >= before) & (here[j] > after) & (response[j] > threshold))


@compiled
def _ordered(a, b):  # type: ignore[no-untyped-def]
    return _greater(a, b), _lesser(a, b)


@compiled
def _greater(a, b):  # type: ignore[no-untyped-def]
    return a if a > b else b


@compiled
def _lesser(a, b):  # type: ignore[no-untyped-def]
    return a if a < b else b


def _places(marked: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Indices (n,) of the bytes that are not zero."""
    whole = len(marked) // 8 * 8
    return np.asarray(_nonzero(marked[:whole].view(np.uint64), marked), dtype=np.int64)


@compiled
def _nonzero(words, marked):  # type: ignore[no-untyped-def]
    """Eight bytes are skipped at a time where all are zero, as most are."""
    places = np.empty(marked.shape[0], np.int64)
    n = 0
    for i in range(words.shape[0] + 1):
        if i < words.shape[0] and words[i] == 0:
            continue
        for j in range(8 * i, min(8 * i + 8, marked.shape[0])):
            if marked[j] != 0:
                places[n] = j
                n += 1
    return places[:n]


@compiled
def _spread_corners(places, strength, cell_px, quota):  # type: ignore[no-untyped-def]
    """Local maxima, x and y (n, 2): the best of every cell, then the second best, until the quota is full."""
    height, width = strength.shape
    n_columns = np.int64(width / cell_px) + 1
    n_cells = n_columns * (np.int64(height / cell_px) + 1)
    key = np.empty(places.shape[0], np.int64)
    n = 0
    for place in places:
        y, x = place // width, place % width
        if x < BORDER_PX or y < BORDER_PX or x >= width - BORDER_PX or y >= height - BORDER_PX:
            continue
        key[n] = (-np.int64(strength[y, x]) << 32) + place
        n += 1
    order = np.sort(key[:n])
    in_cell = np.zeros(n_cells, np.int64)
    rank = np.empty(n, np.int64)
    of_rank = np.zeros(_MAX_RANK + 1, np.int64)
    for i in range(n):
        place = order[i] & 0xFFFFFFFF
        cell = np.int64((place // width) / cell_px) * n_columns + np.int64((place % width) / cell_px)
        rank[i] = min(in_cell[cell], _MAX_RANK)
        in_cell[cell] += 1
        of_rank[rank[i]] += 1
    full, last = 0, 0
    while last < _MAX_RANK and full + of_rank[last] <= quota:
        full += of_rank[last]
        last += 1
    remaining = quota - full
    chosen = np.empty(min(quota, n), np.int64)
    k = 0
    for i in range(n):
        if rank[i] > last or k == chosen.shape[0]:
            continue
        if rank[i] == last:
            if remaining == 0:
                continue
            remaining -= 1
        chosen[k] = order[i] & 0xFFFFFFFF
        k += 1
    xy = np.empty((k, 2), np.int64)
    # In reading order: patches that follow one another share rows that are still near.
    in_reading_order = np.sort(chosen[:k])
    for i in range(k):
        xy[i, 0], xy[i, 1] = in_reading_order[i] % width, in_reading_order[i] // width
    return xy


@compiled
def _peaks(xy, strength):  # type: ignore[no-untyped-def]
    """Highest points (n, 2) float32 of the parabolas through the strength at each maximum and its neighbours."""
    peak = np.empty(xy.shape, np.float32)
    for i in range(xy.shape[0]):
        x, y = xy[i, 0], xy[i, 1]
        here = np.float64(strength[y, x])
        left, right = np.float64(strength[y, x - 1]), np.float64(strength[y, x + 1])
        above, below = np.float64(strength[y - 1, x]), np.float64(strength[y + 1, x])
        peak[i, 0] = x + 0.5 * (right - left) / max(2.0 * here - left - right, 1.0)
        peak[i, 1] = y + 0.5 * (below - above) / max(2.0 * here - above - below, 1.0)
    return peak
