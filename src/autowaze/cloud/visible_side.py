"""Groups of points -> vehicle boxes that know that only the visible side of a vehicle yields points.

The points say where a box lies (`world.visible_side`), and the spot pulls a little: the fewer the points, the more.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.boxes import ROW_REACH_M
from autowaze.cloud.grouping import VehicleGroups
from autowaze.cloud.spots import SpotIndex
from autowaze.world.labels import ClassLabel
from autowaze.world.vehicles import VehicleBoxes
from autowaze.world.visible_side import USUAL_SIZE_M, fitted_boxes, turn_axes

MIN_POINTS = 4
FIT_SIGMA_M = (0.35, 0.12)
"""How far off a box is by its points along and across the vehicle: lengths differ more than widths do."""
POINT_SIGMA_M = (1.0, 0.8)
"""And by how many they are: over the square root of their number."""
PARKED_SIGMA_M = (0.5, 0.45)
"""How far from the middle of a spot vehicles stand, drift of the map included."""
STRAY_SIGMA_M = 0.8
"""One that stands farther off than a few of these stands elsewhere: the spot does not pull it."""


def boxes_from_visible_side(groups: VehicleGroups, spots: SpotIndex, is_pulled: bool = True) -> VehicleBoxes:
    """One box per group of enough points.

    Args:
        is_pulled: whether spots pull boxes towards their middle; else a box lies as its points alone say.
    """
    rows = np.flatnonzero(groups.sizes >= MIN_POINTS)
    views = groups.views[rows]
    nearest = spots.grid.nearest(groups.centroids[rows], ROW_REACH_M)
    in_row = nearest >= 0
    usual = np.array([USUAL_SIZE_M[ClassLabel(label)] for label in views.label.tolist()]).reshape(-1, 2)
    sizes = groups.sizes[rows]
    table = fitted_boxes(
        np.ascontiguousarray(groups.position[:, :2]),
        groups.starts[rows],
        sizes,
        views.view_direction,
        usual,
        np.where(in_row, spots.heading[nearest], 0.0),
    )
    if is_pulled:
        _pull(table, np.where(in_row[:, None], spots.centre[nearest], np.nan), sizes)
    return VehicleBoxes(
        centre=table[:, :2],
        length=table[:, 2],
        width=table[:, 3],
        heading=table[:, 4],
        group=views.key,
        label=views.label,
        confidence=views.confidence,
        points=sizes,
        seen_at=views.seen_at,
    )


@numba.njit(cache=True, nogil=True)
def _pull(table: NDArray[np.float64], spot_centre: NDArray[np.float64], sizes: NDArray[np.int64]) -> None:
    """Move boxes (G, 5) towards the middles of their spots (G, 2), NaN for none, along and across as each is sure."""
    axes = np.empty((2, 2))
    for g in range(len(table)):
        if np.isnan(spot_centre[g, 0]):
            continue
        turn_axes(axes, table[g, 4])
        middle, spot = axes @ table[g, :2], axes @ spot_centre[g]
        away2 = (spot[0] - middle[0]) ** 2 + (spot[1] - middle[1]) ** 2
        belongs = math.exp(-away2 / (2.0 * STRAY_SIGMA_M**2))
        for axis in range(2):
            fit2 = FIT_SIGMA_M[axis] ** 2 + POINT_SIGMA_M[axis] ** 2 / sizes[g]
            middle[axis] += belongs * fit2 / (fit2 + PARKED_SIGMA_M[axis] ** 2) * (spot[axis] - middle[axis])
        table[g, :2] = middle[0] * axes[0] + middle[1] * axes[1]
