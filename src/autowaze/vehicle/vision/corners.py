"""Corners of a pyramid, spread over the image.

The response follows the segment test of FAST (Rosten & Drummond 2006) in a form that needs no branches: on a circle of
radius 3 every pair of opposite pixels must have one that is brighter (or darker) than the centre by the threshold. An
edge fails along its direction, as it does in FAST; the least of those differences is the strength.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.compiled import compiled
from autowaze.vehicle.vision.pyramid import Pyramid
from autowaze.world.columns import Columns
from autowaze.world.frame import Image

BORDER_PX = 19  # half the descriptor's patch and what its rotation and blur need
_RADIUS_PX = 3
_HALF_CIRCLE = ((-3, 0), (0, -3), (-2, -2), (-2, 2))  # rows and columns; the other half lies opposite
_MAX_RANK = 64  # corners of one cell that compete
_NEIGHBOURS = np.ones((3, 3), np.uint8)


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
        self._response = {level: np.zeros_like(pyramid.levels[level]) for level in levels}
        self._bytes = np.zeros((4, largest), np.uint8)
        self._words = np.zeros((2, largest), np.uint16)

    def find(self) -> Corners:
        """Corners of the levels, level by level."""
        return Corners.concatenate([self._find_in_level(level) for level in self._levels])

    def _find_in_level(self, level: int) -> Corners:
        image, response = self._pyramid.levels[level], self._response[level]
        segment_response(image, response, self._bytes)
        peaks, strong = (flat[: image.size].reshape(image.shape) for flat in self._bytes[:2])
        strength, highest = (flat[: image.size].reshape(image.shape) for flat in self._words)
        cv2.boxFilter(response, cv2.CV_16U, (3, 3), dst=strength, normalize=False)  # breaks ties between neighbours
        cv2.dilate(strength, _NEIGHBOURS, dst=highest)
        cv2.compare(strength, highest, cv2.CMP_EQ, dst=peaks)
        cv2.threshold(response, self._threshold, 255, cv2.THRESH_BINARY, dst=strong)
        cv2.bitwise_and(peaks, strong, dst=peaks)
        cell_px = max(np.sqrt(image.size / max(self._quota[level], 1)), 1.0)
        xy = _spread_corners(_places(peaks.reshape(-1)), strength, cell_px, self._quota[level])
        return Corners(xy, np.full(len(xy), level, np.uint8), _peaks(xy, strength))


def segment_response(image: Image, out: Image, scratch: NDArray[np.uint8]) -> None:
    """Corner response (H, W) uint8 of a grey image, in grey levels; 0 within three pixels of the border.

    Args:
        image: (H, W) uint8.
        out: where the response goes.
        scratch: (4, H * W or more) uint8, overwritten.
    """
    r = _RADIUS_PX
    h, w = image.shape
    inner = h - 2 * r, w - 2 * r
    bright, dark, upper, lower = (flat[: inner[0] * inner[1]].reshape(inner) for flat in scratch)
    for i, (dy, dx) in enumerate(_HALF_CIRCLE):
        one, opposite = (image[r + y : h - r + y, r + x : w - r + x] for y, x in ((dy, dx), (-dy, -dx)))
        cv2.max(one, opposite, dst=upper if i else bright)
        cv2.min(one, opposite, dst=lower if i else dark)
        if i:
            cv2.min(bright, upper, dst=bright)
            cv2.max(dark, lower, dst=dark)
    centre = image[r : h - r, r : w - r]
    cv2.subtract(bright, centre, dst=bright)
    cv2.subtract(centre, dark, dst=dark)
    cv2.max(bright, dark, dst=out[r : h - r, r : w - r])


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
    """Local maxima, x and y (n, 2): the best of every cell, then the second best, until the quota is full.

    Of equally strong neighbours the last one in reading order is taken.
    """
    height, width = strength.shape
    n_columns = np.int64(width / cell_px) + 1
    n_cells = n_columns * (np.int64(height / cell_px) + 1)
    key = np.empty(places.shape[0], np.int64)
    n = 0
    for place in places:
        y, x = place // width, place % width
        if x < BORDER_PX or y < BORDER_PX or x >= width - BORDER_PX or y >= height - BORDER_PX:
            continue
        s = strength[y, x]
        after = max(strength[y, x + 1], strength[y + 1, x - 1], strength[y + 1, x], strength[y + 1, x + 1])
        if s > after:
            key[n] = (-np.int64(s) << 32) + place
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
    chosen = np.empty((min(quota, n), 2), np.int64)
    k = 0
    for i in range(n):
        if rank[i] > last or k == chosen.shape[0]:
            continue
        if rank[i] == last:
            if remaining == 0:
                continue
            remaining -= 1
        place = order[i] & 0xFFFFFFFF
        chosen[k, 0], chosen[k, 1] = place % width, place // width
        k += 1
    return chosen[:k]


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
