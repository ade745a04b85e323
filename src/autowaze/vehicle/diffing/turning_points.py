"""The few points of a path that are worth their bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world.map_diff import Trajectory


def turning_points(path: Trajectory, tolerance_m: float) -> NDArray[np.int64]:
    """Rows of a path that tell of the rest: even motion from one to the next misses none by more than the tolerance."""
    kept = [0]
    for row in range(2, len(path)):
        first = kept[-1]
        share = (path.time[first:row] - path.time[first]) / (path.time[row] - path.time[first])
        even = path.position[first] + share[:, None] * (path.position[row] - path.position[first])
        if np.linalg.norm(even - path.position[first:row], axis=1).max() > tolerance_m:
            kept.append(row - 1)
    return np.unique([*kept, len(path) - 1])
