"""Groups of cells that on the whole are one instance: average linkage (GASP; Bailoni et al., CVPR 2022).

The mutex watershed goes by its surest links, so that one reflection in a bonnet or a post before a door parts a
vehicle. Between two groups there are many links; the two whose links join them most on average become one, until no two
groups' links join them on average.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

_MAX_GROUPS = 200
"""The largest; of a busy street there are some sixty, and what is beyond is left alone."""
_MIN_CELLS, _MIN_LINKS = 10, 5
_CERTAIN = 6.0
"""Logit: a link more sure than that counts no more."""


@numba.njit(cache=True, nogil=True)
def average_linkage(
    owner: NDArray[np.int32], count: int, links: NDArray[np.float32], reach: NDArray[np.int64], bias: float
) -> NDArray[np.int32]:
    """Join groups.

    Args:
        owner: (h, w) int32, number of the cell's group, below `count`, -1 for background.
        links: (L, h, w) float32, logit of a cell and the one `reach` away being of one instance.
        reach: (L, 2) int64, columns and rows from a cell to the one it is linked with; rows are not negative.
        bias: added to every logit.

    Returns:
        (h, w) int32, as `owner`; of the groups that were joined the largest one's number stands for all.
    """
    largest, place = _largest(owner, count)
    logit, asked = _between(owner, place, len(largest), links, reach, bias)
    stands_for = np.arange(len(largest))
    while True:
        best, one, other = 0.0, -1, -1
        for a in range(len(largest)):
            for b in range(a + 1, len(largest)):
                if asked[a, b] >= _MIN_LINKS and logit[a, b] > best * asked[a, b]:
                    best, one, other = logit[a, b] / asked[a, b], a, b
        if one < 0:
            break
        for table in (logit, asked):
            table[one] += table[other]
            table[:, one] += table[:, other]
            table[other], table[:, other] = 0.0, 0.0
            table[one, one] = 0.0
        stands_for[stands_for == other] = one
    joined = owner.copy()
    for y in range(owner.shape[0]):
        for x in range(owner.shape[1]):
            if owner[y, x] >= 0 and place[owner[y, x]] >= 0:
                joined[y, x] = largest[stands_for[place[owner[y, x]]]]
    return joined


@numba.njit(cache=True, nogil=True)
def _largest(owner: NDArray[np.int32], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The groups (K,) looked at, largest first, and the place (count,) of each group among them, -1 for none."""
    area = np.zeros(count, np.int64)
    for y in range(owner.shape[0]):
        for x in range(owner.shape[1]):
            if owner[y, x] >= 0:
                area[owner[y, x]] += 1
    order = np.argsort(-area, kind="mergesort")[:_MAX_GROUPS]
    largest = order[area[order] >= _MIN_CELLS]
    place = np.full(count, -1, np.int64)
    place[largest] = np.arange(len(largest))
    return largest, place


@numba.njit(cache=True, nogil=True)
def _between(
    owner: NDArray[np.int32],
    place: NDArray[np.int64],
    groups: int,
    links: NDArray[np.float32],
    reach: NDArray[np.int64],
    bias: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sum and number (K, K) of the links between each two groups, both ways round."""
    height, width = owner.shape
    logit, asked = np.zeros((groups, groups)), np.zeros((groups, groups))
    for link in range(len(reach)):
        dx, dy = reach[link]
        for y in range(height - dy):
            for x in range(max(0, -dx), min(width, width - dx)):
                here, there = owner[y, x], owner[y + dy, x + dx]
                if here < 0 or there < 0 or here == there:
                    continue
                a, b = place[here], place[there]
                if a >= 0 and b >= 0:
                    join = min(max(links[link, y, x] + bias, -_CERTAIN), _CERTAIN)
                    logit[a, b] += join
                    logit[b, a] += join
                    asked[a, b] += 1
                    asked[b, a] += 1
    return logit, asked
