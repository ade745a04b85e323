"""Groups of points -> vehicle boxes: a box of average size around the centroid (thesis, sec. 3.3.4)."""

from __future__ import annotations

import numpy as np

from autowaze.cloud.grouping import VehicleGroups
from autowaze.cloud.spots import SpotIndex
from autowaze.world.vehicles import VehicleBoxes

AVERAGE_LENGTH_M = 4.5
AVERAGE_WIDTH_M = 1.8
ROW_REACH_M = 10.0
"""A vehicle farther from every spot than this stands in no row."""


def boxes_of_average_size(groups: VehicleGroups, spots: SpotIndex) -> VehicleBoxes:
    """One box per group that has points.

    The thesis draws boxes along the axes of its map, whose streets run along those axes. What a box along an axis
    says there is that a parked vehicle stands as the spot next to it does; that is what holds in any street, so the
    box takes the heading of the nearest spot, and that of the map's axes where there is none.
    """
    present = groups.sizes > 0
    centre, views = groups.centroids[present], groups.views[present]
    nearest = spots.grid.nearest(centre, ROW_REACH_M)
    count = len(centre)
    return VehicleBoxes(
        centre=centre,
        length=np.full(count, AVERAGE_LENGTH_M),
        width=np.full(count, AVERAGE_WIDTH_M),
        heading=np.where(nearest >= 0, spots.heading[nearest], 0.0),
        group=views.key,
        label=views.label,
        confidence=views.confidence,
        points=groups.sizes[present],
        seen_at=views.seen_at,
    )
