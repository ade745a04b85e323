"""Cells into instances by what links them: the mutex watershed (Wolf et al., ECCV 2018).

Links are taken in falling order of how sure they are. One that says "the same" joins two groups unless they were
declared apart before; one that says "apart" declares two groups apart unless they were joined before. No number of
instances, no seeds and no thresholds on groups: the surest links decide first.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

_LEVELS = 512
_LEVELS_PER_LOGIT = 50.0
"""Logits beyond ten are all as sure; a bucket sort orders half a million links in the time of reading them."""


@numba.njit(cache=True, nogil=True)
def mutex_watershed(
    kind: NDArray[np.int8], links: NDArray[np.float32], reach: NDArray[np.int64], bias: float
) -> tuple[NDArray[np.int32], int]:
    """Groups of cells that belong together.

    Args:
        kind: (h, w) int8 class of each cell, -1 for background; cells of different classes are never of one group.
        links: (L, h, w) float32, logit of a cell and the one `reach` away being of one instance.
        reach: (L, 2) int64, columns and rows from a cell to the one it is linked with; rows are not negative.
        bias: added to every logit.

    Returns:
        owner: (h, w) int32, number of the cell's group, -1 for background.
        count: of groups.
    """
    first, second, joins = _sorted_links(kind, links, reach, bias)
    height, width = kind.shape
    parent = np.arange(height * width).astype(np.int32)
    # the groups that a group is apart from, as linked lists, so that joining two groups joins their lists
    head, tail = np.full(height * width, -1, np.int32), np.full(height * width, -1, np.int32)
    length = np.zeros(height * width, np.int32)
    following, other = np.empty(2 * len(first), np.int32), np.empty(2 * len(first), np.int32)
    used = 0
    for edge in range(len(first)):
        a, b = _root(parent, first[edge]), _root(parent, second[edge])
        if length[a] > length[b]:
            a, b = b, a
        if a == b or _apart(parent, head, following, other, a, b):
            continue
        if joins[edge]:
            parent[a] = b
            if head[b] < 0:
                head[b] = head[a]
            elif head[a] >= 0:
                following[tail[b]] = head[a]
            if head[a] >= 0:
                tail[b] = tail[a]
            length[b] += length[a]
        else:
            for here, there in ((a, b), (b, a)):
                other[used], following[used] = there, -1
                if head[here] < 0:
                    head[here] = used
                else:
                    following[tail[here]] = used
                tail[here] = used
                length[here] += 1
                used += 1
    return _numbered(kind, parent)


@numba.njit(cache=True, nogil=True)
def _sorted_links(
    kind: NDArray[np.int8], links: NDArray[np.float32], reach: NDArray[np.int64], bias: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.bool_]]:
    """Cells (E,) at both ends of each link between cells of one class, and whether it joins, the surest first."""
    height, width = kind.shape
    rows, columns = np.nonzero(kind >= 0)
    # what a link is sure of, kept from the first look to the second; -1 where it ties nothing
    level = np.empty((len(reach), len(rows)), np.int16)
    start = np.zeros(_LEVELS + 1, np.int64)
    for link in range(len(reach)):
        dx, dy = reach[link]
        for i in range(len(rows)):
            y, x = rows[i], columns[i]
            level[link, i] = -1
            if y + dy < height and 0 <= x + dx < width and kind[y + dy, x + dx] == kind[y, x]:
                sureness = abs(links[link, y, x] + bias) * _LEVELS_PER_LOGIT
                level[link, i] = _LEVELS - 1 - int(min(sureness, _LEVELS - 1.0))
                start[level[link, i] + 1] += 1
    start = np.cumsum(start)
    first, second = np.empty(start[-1], np.int32), np.empty(start[-1], np.int32)
    joins = np.empty(start[-1], np.bool_)
    for link in range(len(reach)):
        step = reach[link, 1] * width + reach[link, 0]
        for i in range(len(rows)):
            if level[link, i] >= 0:
                place = start[level[link, i]]
                start[level[link, i]] += 1
                cell = rows[i] * width + columns[i]
                first[place], second[place] = cell, cell + step
                joins[place] = links[link, rows[i], columns[i]] + bias > 0
    return first, second, joins


@numba.njit(cache=True, nogil=True)
def _root(parent: NDArray[np.int32], cell: int) -> int:
    while parent[cell] != cell:
        parent[cell] = parent[parent[cell]]
        cell = parent[cell]
    return cell


@numba.njit(cache=True, nogil=True)
def _apart(
    parent: NDArray[np.int32],
    head: NDArray[np.int32],
    following: NDArray[np.int32],
    other: NDArray[np.int32],
    a: int,
    b: int,
) -> bool:
    """Whether group a was declared apart from group b."""
    entry = head[a]
    while entry >= 0:
        if _root(parent, other[entry]) == b:
            return True
        entry = following[entry]
    return False


@numba.njit(cache=True, nogil=True)
def _numbered(kind: NDArray[np.int8], parent: NDArray[np.int32]) -> tuple[NDArray[np.int32], int]:
    height, width = kind.shape
    owner = np.full((height, width), -1, np.int32)
    number = np.full(height * width, -1, np.int32)
    count = 0
    for y in range(height):
        for x in range(width):
            if kind[y, x] >= 0:
                root = _root(parent, y * width + x)
                if number[root] < 0:
                    number[root] = count
                    count += 1
                owner[y, x] = number[root]
    return owner, count
