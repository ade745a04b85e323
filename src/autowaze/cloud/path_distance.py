"""How points lie to a path, compiled."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True, nogil=True)
def all_within(points: NDArray[np.float64], path: NDArray[np.float64], within_m: float) -> bool:
    """Whether each point (N, 2 or more) is so near, along two axes, to the polyline through path (M > 0, 2 or more)."""
    pieces = max(len(path) - 1, 1)
    last = 0
    for row in range(len(points)):
        near = False
        for turn in range(pieces):
            piece = (last + turn) % pieces  # points come sorted by place, so the piece near the last one is tried first
            x0, y0 = path[piece, 0], path[piece, 1]
            x1, y1 = path[min(piece + 1, len(path) - 1), 0], path[min(piece + 1, len(path) - 1), 1]
            x, y, step_x, step_y = points[row, 0] - x0, points[row, 1] - y0, x1 - x0, y1 - y0
            length2 = max(step_x * step_x + step_y * step_y, 1e-12)
            share = min(max((x * step_x + y * step_y) / length2, 0.0), 1.0)
            x, y = x - share * step_x, y - share * step_y
            if x * x + y * y <= within_m * within_m:
                last, near = piece, True
                break
        if not near:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def away_from(points: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (N, 2) to points (N, 2) from where the polyline through path (M, 2), M > 1, is nearest to each.

    Zero for a point on the path.
    """
    away = np.zeros((len(points), 2))
    for row in range(len(points)):
        least = np.inf
        for piece in range(len(path) - 1):
            x0, y0 = path[piece]
            step_x, step_y = path[piece + 1, 0] - x0, path[piece + 1, 1] - y0
            x, y = points[row, 0] - x0, points[row, 1] - y0
            length2 = max(step_x * step_x + step_y * step_y, 1e-12)
            share = min(max((x * step_x + y * step_y) / length2, 0.0), 1.0)
            x, y = x - share * step_x, y - share * step_y
            if x * x + y * y < least:
                least = x * x + y * y
                away[row] = x, y
        away[row] /= max(np.sqrt(least), 1e-6)
    return away
