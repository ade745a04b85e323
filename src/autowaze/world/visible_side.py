"""Points of a vehicle -> its box, knowing that only the visible side of a vehicle yields points.

A centroid lies 0.85 m (in bays 1.6 m) nearer to the camera than the vehicle's centre. Here the points give the near
faces of the box, the view direction tells which faces these are, and the usual size of the class gives the rest.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.world.labels import ClassLabel

USUAL_SIZE_M = {ClassLabel.CAR: (4.3, 1.8), ClassLabel.TRUCK: (5.2, 2.0), ClassLabel.BUS: (10.0, 2.5)}
"""Length and width; segmentation networks trained on COCO call vans and pick-ups trucks."""
LONGEST_M = 14.0
CROSSWISE_M = 1.0
"""A group that is wider than a vehicle by this, and than it is long, stands across its row."""
END_QUANTILES = (0.05, 0.95)
FACE_QUANTILES = (0.08, 0.12)
"""Where the faces of a vehicle lie in the spread of its points along and across it: some lie behind the face, on
bonnet, roof and through windows; some before it, by depth noise. Along the vehicle its whole side adds to those behind,
where every hundredth of the points is some 4 cm."""
SEEN_LENGTH_SHARE = (0.4, 0.6)
"""Points that span more of a vehicle's length than this lie along its side; fewer, on its near end only."""
UNSEEN_END_M, UNSEEN_END_SIGMA_M = 0.7, 0.3
"""How far before the far end of a vehicle the points of its side end: no car that passes sees that end."""
LENGTH_SIGMA_M = 0.35
"""How much lengths of one class differ."""
CERTAIN_VIEW = 0.15
"""Share of the view along an axis from which on it is certain which of two opposite faces was seen."""


@numba.njit(cache=True, nogil=True)
def fitted_boxes(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    sizes: NDArray[np.int64],
    view_direction: NDArray[np.float64],
    usual: NDArray[np.float64],
    row_heading: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Centre x, y, length, width, heading (G, 5) of the boxes around groups of points (P, 2).

    Args:
        points: map metres; those of group g are rows starts[g] to starts[g] + sizes[g], at least one.
        view_direction: (G, 2) horizontal, against which the visible side faces, at most of length 1.
        usual: (G, 2) length and width of such a vehicle.
        row_heading: (G,) compass heading of vehicles that are parked there, radians; one that is wide and short stands
            across it.
    """
    table = np.empty((len(starts), 5))
    axes, middle, size, facing = np.empty((2, 2)), np.empty(2), np.empty(2), np.empty(2)
    for g in range(len(starts)):
        own = points[starts[g] : starts[g] + sizes[g]]
        heading = row_heading[g]
        turn_axes(axes, heading)
        along, across = np.sort(own @ axes[0]), np.sort(own @ axes[1])
        wide = _quantile(across, END_QUANTILES[1]) - _quantile(across, END_QUANTILES[0])
        long = _quantile(along, END_QUANTILES[1]) - _quantile(along, END_QUANTILES[0])
        if wide > max(usual[g, 1] + CROSSWISE_M, long):
            heading = (heading + np.pi / 2) % np.pi
            turn_axes(axes, heading)
            along, across = np.sort(own @ axes[0]), np.sort(own @ axes[1])
            long = _quantile(along, END_QUANTILES[1]) - _quantile(along, END_QUANTILES[0])
        size[0], size[1] = min(max(long, usual[g, 0]), LONGEST_M), usual[g, 1]
        for axis in range(2):
            ascending = along if axis == 0 else across
            low, high = _quantile(ascending, FACE_QUANTILES[axis]), _quantile(ascending, 1.0 - FACE_QUANTILES[axis])
            towards = axes[axis, 0] * view_direction[g, 0] + axes[axis, 1] * view_direction[g, 1]
            towards = facing[axis] = min(max(towards / CERTAIN_VIEW, -1.0), 1.0)
            near = low if towards > 0 else high
            near = near * abs(towards) + (low + high) / 2 * (1.0 - abs(towards))
            middle[axis] = near + towards * size[axis] / 2
        share = (long / usual[g, 0] - SEEN_LENGTH_SHARE[0]) / (SEEN_LENGTH_SHARE[1] - SEEN_LENGTH_SHARE[0])
        share = min(max(share, 0.0), 1.0)
        low, high = _quantile(along, END_QUANTILES[0]), _quantile(along, END_QUANTILES[1])
        told = share * LENGTH_SIGMA_M**2 / (LENGTH_SIGMA_M**2 + UNSEEN_END_SIGMA_M**2)
        longer = told * (min(long + UNSEEN_END_M, LONGEST_M) - size[0])
        sure = abs(facing[0])
        middle[0] += sure * facing[0] * longer / 2 + (1.0 - sure) * share * ((low + high) / 2 - middle[0])
        size[0] += sure * longer
        table[g, :2] = middle[0] * axes[0] + middle[1] * axes[1]
        table[g, 2], table[g, 3], table[g, 4] = size[0], size[1], heading
    return table


@numba.njit(cache=True, nogil=True)
def turn_axes(axes: NDArray[np.float64], heading: float) -> None:
    """Make the axes (2, 2) lie along and across this heading."""
    sin, cos = math.sin(heading), math.cos(heading)
    axes[0, 0], axes[0, 1], axes[1, 0], axes[1, 1] = sin, cos, cos, -sin


@numba.njit(cache=True, nogil=True)
def _quantile(ascending: NDArray[np.float64], share: float) -> float:
    """Quantile of sorted values (N,), linear between ranks."""
    rank = share * (len(ascending) - 1)
    below = int(rank)
    above = min(below + 1, len(ascending) - 1)
    return float(ascending[below] * (1.0 - (rank - below)) + ascending[above] * (rank - below))
