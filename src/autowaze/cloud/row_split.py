"""Groups too large for one vehicle are cut where the spots of their row meet.

In a dense row a mask may take in the next car, and an id may jump to it; their points then hang together. The row
says how far apart vehicles stand, the points say where: a row may be drawn, and a car localised, half a metre off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.boxes import ROW_REACH_M
from autowaze.cloud.grouping import VehicleGroups
from autowaze.cloud.spots import SpotIndex
from autowaze.cloud.visible_side import MIN_POINTS
from autowaze.world.labels import ClassLabel
from autowaze.world.visible_side import USUAL_SIZE_M

SPAN_QUANTILES = (0.03, 0.97)
ALLOWANCE_M = (1.5, 0.7)
"""Beyond the usual length and width of a vehicle; a group that spans more is not one vehicle."""
SHIFTS_M = np.linspace(-0.75, 0.75, 11)
SAMPLE_M = 1.0
SHIFT_COST = 0.1
"""Per metre that the row is off, in metres by which a point lies outside of every vehicle."""


def split_along_rows(groups: VehicleGroups, spots: SpotIndex) -> VehicleGroups:
    """Cut groups that are longer or wider than one vehicle into those that lie in one slot each."""
    nearest = spots.grid.nearest(groups.centroids, ROW_REACH_M)
    usual = np.array([USUAL_SIZE_M[ClassLabel(label)] for label in groups.views.label.tolist()]).reshape(-1, 2)
    axes = _axes(spots.heading[nearest])
    excess = _spans(groups, axes) - usual - ALLOWANCE_M
    large = (excess > 0).any(axis=1) & (nearest >= 0) & (groups.sizes >= 2 * MIN_POINTS)
    if not large.any():
        return groups
    part, starts = np.zeros(len(groups.position), np.int64), groups.starts
    for row in np.flatnonzero(large).tolist():
        points, side = slice(starts[row], starts[row + 1]), int(np.argmax(excess[row]))
        part[points] = _slots(groups.position[points, :2], spots, axes[row, side], float(usual[row, side]))
    order = np.lexsort((part, groups.group))
    owner, part = groups.group[order], part[order]
    first = np.r_[True, (np.diff(owner) != 0) | (np.diff(part) != 0)]
    return VehicleGroups(groups.position[order], np.cumsum(first) - 1, groups.views[owner[first]])


def _axes(heading: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (G, 2, 2) along and across vehicles of these headings (G,)."""
    sin, cos = np.sin(heading), np.cos(heading)
    return np.stack([np.stack([sin, cos], axis=1), np.stack([cos, -sin], axis=1)], axis=1)


def _spans(groups: VehicleGroups, axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far the points of each group reach along its axes (G, 2), a few stray ones left out; 0 without points."""
    own = np.einsum("pab,pb->pa", axes[groups.group], groups.position[:, :2])
    starts, last = groups.starts[:-1], groups.sizes - 1
    low, high = (starts + np.round(share * last).astype(np.int64) for share in SPAN_QUANTILES)
    spans = np.zeros((len(groups), 2))
    some = last >= 0
    for axis in (0, 1):
        ascending = own[np.lexsort((own[:, axis], groups.group)), axis]
        spans[some, axis] = ascending[high[some]] - ascending[low[some]]
    return spans


def _slots(
    points: NDArray[np.float64], spots: SpotIndex, axis: NDArray[np.float64], usual_m: float
) -> NDArray[np.int64]:
    """Number of the slot (N,) that each point (N, 2) lies in along an axis.

    Slots end half-way between the middles of spots, all moved along the row so that vehicles of the usual size in the
    middle of each leave the fewest points between them.
    """
    along = points @ axis
    steps = np.arange(along.min() - SAMPLE_M, along.max() + 2.0 * SAMPLE_M, SAMPLE_M)[:, None]
    middle = points.mean(axis=0)
    row = spots.grid.nearest(middle + (steps - middle @ axis) * axis, 2.0 * ROW_REACH_M)
    middles = np.unique(np.round(spots.centre[row[row >= 0]] @ axis, 2))
    ends = (middles[1:] + middles[:-1]) / 2
    moved = along - SHIFTS_M[:, None]
    slot = np.searchsorted(ends, moved)
    outside = np.maximum(np.abs(moved - middles[slot]) - usual_m / 2, 0.0).mean(axis=1)
    return np.asarray(slot[np.argmin(outside + SHIFT_COST * np.abs(SHIFTS_M))], dtype=np.int64)
