"""Loops over the columns of a diff, compiled: a check has looked at all rows before numpy would have begun."""

# ruff: noqa: SIM110 - numba compiles no generators

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.world.identity import INSTANCE_BITS, ROW_BITS


@numba.njit(cache=True, nogil=True)
def numbered_from(ids: NDArray[np.uint64], first: np.uint64) -> bool:
    """Whether ids (N,) are the numbers from the first on."""
    for row in range(len(ids)):
        if ids[row] != first + np.uint64(row):
            return False
    return True


@numba.njit(cache=True, nogil=True)
def of_session(keys: NDArray[np.uint64], session: np.uint64) -> bool:
    """Whether all instance keys (N,) but 0 are of a session."""
    for row in range(len(keys)):
        if keys[row] != 0 and keys[row] >> np.uint64(INSTANCE_BITS) != session:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def ascends(ids: NDArray[np.uint64]) -> bool:
    """Whether each of the ids (N,) is larger than the one before."""
    for row in range(1, len(ids)):
        if ids[row] <= ids[row - 1]:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def extent_of_places(position: NDArray[np.float64], path: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Lowest and highest x and y of positions (N, 3) and a path (M, 3); not a number if any of them is not.

    Of positions the height must be a number, too.
    """
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for part in range(2):
        places = path if part else position
        for row in range(len(places)):
            x, y = places[row, 0], places[row, 1]
            if not math.isfinite(x + y) or (part == 0 and not math.isfinite(places[row, 2])):
                return np.nan, np.nan, np.nan, np.nan
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
    return x0, x1, y0, y1


@numba.njit(cache=True, nogil=True)
def extent_of_cells(ix: NDArray[np.int32], iy: NDArray[np.int32]) -> tuple[int, int, int, int, bool]:
    """Lowest and highest x and y of ground cells (N > 0,), and whether they are sorted by y, then x, each once."""
    x0 = x1 = int(ix[0])
    y0 = y1 = int(iy[0])
    ascend = True
    for row in range(1, len(ix)):
        x, y = int(ix[row]), int(iy[row])
        x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
        if iy[row] < iy[row - 1] or (iy[row] == iy[row - 1] and ix[row] <= ix[row - 1]):
            ascend = False
    return x0, x1, y0, y1, ascend


class PathFacts(NamedTuple):
    """What a path (M > 0,) says at a glance.

    Attributes:
        begin, end: its earliest and latest time, seconds since the epoch.
        in_order: whether time never goes back along it.
        length_m: over the ground.
        lowest_m, highest_m: heights.
        outside_m: how far it leads out of a rectangle.
    """

    begin: float
    end: float
    in_order: bool
    length_m: float
    lowest_m: float
    highest_m: float
    outside_m: float


@numba.njit(cache=True, nogil=True)
def path_facts(
    time: NDArray[np.float64], position: NDArray[np.float64], rectangle: NDArray[np.float64]
) -> tuple[float, float, bool, float, float, float, float]:
    """`PathFacts` of times (M,) and positions (M, 3); the rectangle (4,) is x0, y0, x1, y1."""
    in_order, length_m, outside_m = True, 0.0, 0.0
    for row in range(len(time)):
        x, y = position[row, 0], position[row, 1]
        away_x, away_y = max(rectangle[0] - x, x - rectangle[2], 0.0), max(rectangle[1] - y, y - rectangle[3], 0.0)
        outside_m = max(outside_m, math.hypot(away_x, away_y))
        if row:
            length_m += math.hypot(x - position[row - 1, 0], y - position[row - 1, 1])
            in_order = in_order and time[row] >= time[row - 1]
    return time.min(), time.max(), in_order, length_m, position[:, 2].min(), position[:, 2].max(), outside_m


@numba.njit(cache=True, nogil=True)
def is_orderly(
    time: NDArray[np.float64],
    position: NDArray[np.float64],
    heading: NDArray[np.float32],
    since: float,
    until: float,
) -> bool:
    """Whether a path (M,) lies within a time, moves on with every row and has nothing but numbers in it."""
    for row in range(len(time)):
        if not (since <= time[row] <= until and math.isfinite(heading[row])):
            return False
        if not math.isfinite(position[row, 0] + position[row, 1] + position[row, 2]):
            return False
        if row and time[row] <= time[row - 1]:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def most_frames(
    observations: NDArray[np.uint16],
    free: NDArray[np.uint16],
    obstacle: NDArray[np.uint16],
    instances: NDArray[np.uint16],
) -> int:
    """In how many frames a feature (N,), a ground cell (C,) or an instance (I,) was seen at most."""
    most = 0
    for row in range(len(observations)):
        most = max(most, int(observations[row]))
    for row in range(len(free)):
        most = max(most, int(free[row]) + int(obstacle[row]))
    for row in range(len(instances)):
        most = max(most, int(instances[row]))
    return most


@numba.njit(cache=True, nogil=True)
def all_between(values: NDArray[np.floating], low: float, high: float) -> bool:
    """Whether all values (N,) lie there."""
    for row in range(len(values)):
        if not low <= values[row] <= high:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def starts_of_blocks(ids: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Where each block's ids begin among ascending ids (K,) of features, and K."""
    starts = np.empty(len(ids) + 1, np.int64)
    count = 0
    for row in range(len(ids)):
        if row == 0 or ids[row] >> np.uint64(ROW_BITS) != ids[row - 1] >> np.uint64(ROW_BITS):
            starts[count] = row
            count += 1
    starts[count] = len(ids)
    return starts[: count + 1]


@numba.njit(cache=True, nogil=True)
def among(ids: NDArray[np.uint64], others: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Which of the ids (N,) are among the others (M,), both ascending."""
    found = np.zeros(len(ids), np.bool_)
    other = 0
    for row in range(len(ids)):
        while other < len(others) and others[other] < ids[row]:
            other += 1
        found[row] = other < len(others) and others[other] == ids[row]
    return found


@numba.njit(cache=True, nogil=True)
def any_of(keys: NDArray[np.uint64], wanted: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Which of the keys (N,) are any of a few wanted ones (K,), in no order."""
    found = np.zeros(len(keys), np.bool_)
    for row in range(len(keys)):
        for one in range(len(wanted)):
            if keys[row] == wanted[one]:
                found[row] = True
                break
    return found
