"""Distances between the points of a group, compiled.

A group holds a few hundred points at most, so all pairs of a group are faster than building a tree.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True)
def count_neighbours(position: NDArray[np.float64], starts: NDArray[np.int64], radius_m: float) -> NDArray[np.int64]:
    """How many others of its group each point (P, K) has within the radius, (P,).

    Group g is rows starts[g] to starts[g + 1].
    """
    count = np.zeros(len(position), np.int64)
    for g in range(len(starts) - 1):
        for i in range(starts[g], starts[g + 1]):
            for j in range(i + 1, starts[g + 1]):
                if _squared_distance(position, i, j) <= radius_m * radius_m:
                    count[i] += 1
                    count[j] += 1
    return count


@numba.njit(cache=True)
def number_parts(position: NDArray[np.float64], starts: NDArray[np.int64], gap_m: float) -> NDArray[np.int64]:
    """Part (P,) of each point (P, K): points linked by steps of at most the gap, within their group.

    Parts are numbered from 0 on, in the order of the groups and of their first points.
    """
    part = np.full(len(position), -1, np.int64)
    reached = np.empty(len(position), np.int64)
    parts = 0
    for g in range(len(starts) - 1):
        for first in range(starts[g], starts[g + 1]):
            if part[first] >= 0:
                continue
            part[first] = parts
            reached[0] = first
            waiting = 1
            while waiting > 0:
                waiting -= 1
                i = reached[waiting]
                for j in range(first + 1, starts[g + 1]):
                    if part[j] < 0 and _squared_distance(position, i, j) <= gap_m * gap_m:
                        part[j] = parts
                        reached[waiting] = j
                        waiting += 1
            parts += 1
    return part


@numba.njit(cache=True)
def _squared_distance(position: NDArray[np.float64], i: int, j: int) -> float:
    total = 0.0
    for axis in range(position.shape[1]):
        step = position[i, axis] - position[j, axis]
        total += step * step
    return total
