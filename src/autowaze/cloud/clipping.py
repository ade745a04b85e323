"""What outlines on the ground have in common."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True, nogil=True)
def clipped_area_m2(ring: NDArray[np.float64], box: NDArray[np.float64]) -> float:
    """Area of an outline (N, 2) clipped by the sides of a convex box (4, 2) (Sutherland and Hodgman 1974)."""
    turn = 1.0
    if (box[1, 0] - box[0, 0]) * (box[2, 1] - box[1, 1]) < (box[1, 1] - box[0, 1]) * (box[2, 0] - box[1, 0]):
        turn = -1.0
    count = len(ring)
    # Each side adds half of the corners again at most.
    left, clipped = np.empty((6 * count + 8, 2)), np.empty((6 * count + 8, 2))
    left[:count] = ring
    for side in range(4):
        x0, y0 = box[side]
        x1, y1 = box[(side + 1) % 4]
        kept = 0
        for row in range(count):
            ax, ay = left[row]
            bx, by = left[(row + 1) % count]
            a = turn * ((x1 - x0) * (ay - y0) - (y1 - y0) * (ax - x0))
            b = turn * ((x1 - x0) * (by - y0) - (y1 - y0) * (bx - x0))
            if a >= 0.0:
                clipped[kept, 0], clipped[kept, 1] = ax, ay
                kept += 1
            if (a >= 0.0) != (b >= 0.0):
                clipped[kept, 0] = ax + (bx - ax) * a / (a - b)
                clipped[kept, 1] = ay + (by - ay) * a / (a - b)
                kept += 1
        left, clipped = clipped, left
        count = kept
        if count < 3:
            return 0.0
    return outline_area_m2(left, count)


@numba.njit(cache=True, nogil=True)
def outline_area_m2(ring: NDArray[np.float64], count: int) -> float:
    """Area within the first `count` corners of a ring."""
    total = 0.0
    for row in range(count):  # from the first corner: products of map coordinates would lose digits
        ax, ay = ring[row, 0] - ring[0, 0], ring[row, 1] - ring[0, 1]
        bx, by = ring[(row + 1) % count, 0] - ring[0, 0], ring[(row + 1) % count, 1] - ring[0, 1]
        total += ax * by - ay * bx
    return abs(total) / 2
