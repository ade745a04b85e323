"""Groups of points -> vehicle boxes that know that only the visible side of a vehicle yields points.

A centroid lies 0.85 m (in bays 1.6 m) nearer to the camera than the vehicle's centre. Here the points give the near
faces of the box, the mean view direction tells which faces these are, and the usual size of the class gives the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.boxes import ROW_REACH_M
from autowaze.cloud.grouping import VehicleGroups
from autowaze.cloud.spots import SpotIndex
from autowaze.world.labels import ClassLabel
from autowaze.world.vehicles import VehicleBoxes

MIN_POINTS = 4
USUAL_SIZE_M = {ClassLabel.CAR: (4.3, 1.8), ClassLabel.TRUCK: (5.2, 2.0), ClassLabel.BUS: (10.0, 2.5)}
"""Length and width; segmentation networks trained on COCO call vans and pick-ups trucks."""
LARGEST_M = (14.0, 3.0)
FACE_PERCENTILES = (6.0, 94.0)
"""Where the faces of a vehicle lie in the spread of its points; depth noise makes the spread wider than the vehicle."""
CERTAIN_VIEW = 0.35
"""Share of the view along an axis from which on the near face is the one whose points we have."""


def boxes_from_visible_side(groups: VehicleGroups, spots: SpotIndex) -> VehicleBoxes:
    """One box per group of enough points."""
    rows = np.flatnonzero(groups.sizes >= MIN_POINTS)
    views = groups.views[rows]
    nearest = spots.nearest(groups.centroids[rows], ROW_REACH_M)
    row_heading = np.where(nearest >= 0, spots.heading[nearest], 0.0)
    fitted = [
        _fit(groups.position[groups.group == row, :2], direction, USUAL_SIZE_M[ClassLabel(label)], heading)
        for row, direction, label, heading in zip(
            rows, views.view_direction, views.label.tolist(), row_heading, strict=True
        )
    ]
    table = np.array(fitted).reshape(-1, 5)
    return VehicleBoxes(
        centre=table[:, :2],
        length=table[:, 2],
        width=table[:, 3],
        heading=table[:, 4],
        group=views.key,
        label=views.label,
        confidence=views.confidence,
        points=groups.sizes[rows],
        seen_at=views.seen_at,
    )


def _fit(
    points: NDArray[np.float64], view_direction: NDArray[np.float64], usual: tuple[float, float], heading: float
) -> tuple[float, float, float, float, float]:
    """Centre x, y, length, width, heading of the box around points (N, 2)."""
    along = np.array([np.sin(heading), np.cos(heading)])
    across = np.array([np.cos(heading), -np.sin(heading)])
    low, high = np.percentile(points @ np.stack([along, across]).T, FACE_PERCENTILES, axis=0)
    if high[1] - low[1] > max(usual[1] + 1.0, high[0] - low[0]):  # it stands across the row
        along, across, heading = across, -along, (heading + np.pi / 2) % np.pi
        low, high = np.array([low[1], -high[0]]), np.array([high[1], -low[0]])
    view = np.array([view_direction @ along, view_direction @ across])
    size = np.clip(high - low, usual, LARGEST_M)
    hidden = size - (high - low)
    middle = (low + high) / 2 + np.clip(view / CERTAIN_VIEW, -1.0, 1.0) * hidden / 2
    centre = middle[0] * along + middle[1] * across
    return float(centre[0]), float(centre[1]), float(size[0]), float(size[1]), float(heading)
