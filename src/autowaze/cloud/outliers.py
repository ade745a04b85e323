"""Neighbourhood outlier removal: a point without enough neighbours of its own group goes (thesis, sec. 3.3.3)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from autowaze.cloud.grouping import VehicleGroups

NEIGHBOUR_RADIUS_M = 1.0
ENOUGH_NEIGHBOURS = 3
_APART_M = 1e5


def remove_outliers(
    groups: VehicleGroups, radius_m: float = NEIGHBOUR_RADIUS_M, enough: int = ENOUGH_NEIGHBOURS
) -> VehicleGroups:
    """Drop points that have fewer than `enough` others of their group within the radius.

    Groups are set far apart along a fourth axis, so that one tree answers for all of them.
    """
    if len(groups.position) <= enough:
        return groups.keep(np.zeros(len(groups.position), np.bool_))
    apart = np.column_stack([groups.position, groups.group * _APART_M])
    distance = np.asarray(cKDTree(apart).query(apart, k=[enough + 1], distance_upper_bound=radius_m)[0])
    return groups.keep(np.isfinite(distance[:, 0]))
