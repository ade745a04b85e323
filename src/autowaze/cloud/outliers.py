"""Neighbourhood outlier removal: a point without enough neighbours of its own group goes (thesis, sec. 3.3.3)."""

from __future__ import annotations

from autowaze.cloud.grouping import VehicleGroups
from autowaze.cloud.neighbours import count_neighbours

NEIGHBOUR_RADIUS_M = 1.0
ENOUGH_NEIGHBOURS = 3


def remove_outliers(
    groups: VehicleGroups, radius_m: float = NEIGHBOUR_RADIUS_M, enough: int = ENOUGH_NEIGHBOURS
) -> VehicleGroups:
    """Drop points that have fewer than `enough` others of their group within the radius."""
    return groups.keep(count_neighbours(groups.position, groups.starts, radius_m) >= enough)
