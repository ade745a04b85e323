"""Which of many boxes lie on each other, compiled.

Boxes are convex outlines (4, 2), counter-clockwise, as `world.vehicles.box_corners` draws them. Only neighbours are
compared: along x nobody is farther from a box than the longest one is long.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.clipping import clipped_area_m2, outline_area_m2


@numba.njit(cache=True, nogil=True)
def leaders_and_clusters(corners: NDArray[np.float64], least_iou: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Whom each box (N, 4, 2) follows (N,), and the first box (N,) of those that it hangs together with.

    In the order of rows each box that follows nobody yet leads itself and all others without a leader whose
    intersection over union with it is at least that. Boxes hang together that a chain of such pairs links.
    """
    count = len(corners)
    leader, parent = np.full(count, -1, np.int64), np.arange(count)
    middle = np.empty((count, 2))
    reach2 = 0.0
    for row in range(count):
        middle[row, 0] = (corners[row, 0, 0] + corners[row, 2, 0]) / 2
        middle[row, 1] = (corners[row, 0, 1] + corners[row, 2, 1]) / 2
        reach2 = max(
            reach2, (corners[row, 0, 0] - corners[row, 2, 0]) ** 2 + (corners[row, 0, 1] - corners[row, 2, 1]) ** 2
        )
    reach = np.sqrt(reach2)
    by_x = np.argsort(middle[:, 0], kind="mergesort")
    place = np.empty(count, np.int64)
    place[by_x] = np.arange(count)
    for row in range(count):
        leads = leader[row] < 0
        if leads:
            leader[row] = row
        for step in (-1, 1):
            at = place[row] + step
            while 0 <= at < count and abs(middle[by_x[at], 0] - middle[row, 0]) <= reach:
                other = by_x[at]
                at += step
                wanted = leads and leader[other] < 0
                if not wanted and (other > row or _root(parent, other) == _root(parent, row)):
                    continue  # a pair that is not wanted is looked at once, when its later row comes
                if (middle[other, 1] - middle[row, 1]) ** 2 > reach2:
                    continue
                if _iou(corners[row], corners[other]) >= least_iou:
                    if wanted:
                        leader[other] = row
                    one, two = _root(parent, row), _root(parent, other)
                    parent[max(one, two)] = min(one, two)
    for row in range(count):
        parent[row] = _root(parent, row)
    return leader, parent


@numba.njit(cache=True, nogil=True)
def lie_on_any(corners: NDArray[np.float64], others: NDArray[np.float64], least_iou: float) -> NDArray[np.bool_]:
    """Which boxes (N, 4, 2) have so much in common with any of the others (M, 4, 2)."""
    found = np.zeros(len(corners), np.bool_)
    for row in range(len(corners)):
        for other in range(len(others)):
            if _iou(corners[row], others[other]) >= least_iou:
                found[row] = True
                break
    return found


@numba.njit(cache=True, nogil=True)
def _root(parent: NDArray[np.int64], row: int) -> int:
    while parent[row] != row:
        parent[row] = parent[parent[row]]
        row = parent[row]
    return row


@numba.njit(cache=True, nogil=True)
def _iou(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Intersection over union of two convex outlines; 0 without a look where their bounds lie apart."""
    for axis in range(2):
        low_one = min(one[0, axis], one[1, axis], one[2, axis], one[3, axis])
        high_one = max(one[0, axis], one[1, axis], one[2, axis], one[3, axis])
        low_other = min(other[0, axis], other[1, axis], other[2, axis], other[3, axis])
        high_other = max(other[0, axis], other[1, axis], other[2, axis], other[3, axis])
        if low_one > high_other or low_other > high_one:
            return 0.0
    common = clipped_area_m2(one, other)
    return common / (outline_area_m2(one, 4) + outline_area_m2(other, 4) - common)
