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
LONGEST_M = 14.0
END_QUANTILES = (0.05, 0.95)
FACE_QUANTILES = (0.12, 0.88)
"""Where the faces of a vehicle lie in the spread of its points: some lie behind the face, on bonnet, roof and through
windows; some before it, by depth noise."""
SEEN_LENGTH_SHARE = (0.4, 0.6)
"""Points that span more of a vehicle's length than this lie along its whole side; fewer, on its near end only."""
CERTAIN_VIEW = 0.15
"""Share of the view along an axis from which on it is certain which of two opposite faces was seen."""


def boxes_from_visible_side(groups: VehicleGroups, spots: SpotIndex) -> VehicleBoxes:
    """One box per group of enough points."""
    rows = np.flatnonzero(groups.sizes >= MIN_POINTS)
    views = groups.views[rows]
    nearest = spots.grid.nearest(groups.centroids[rows], ROW_REACH_M)
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
    axes = np.stack([along, across])
    coordinates = np.sort(points @ axes.T, axis=0)
    ends, faces = _ends_and_faces(coordinates)
    if ends[1, 1] - ends[0, 1] > max(usual[1] + 1.0, ends[1, 0] - ends[0, 0]):  # it stands across the row
        axes, heading = np.stack([across, -along]), (heading + np.pi / 2) % np.pi
        coordinates = np.sort(points @ axes.T, axis=0)
        ends, faces = _ends_and_faces(coordinates)
    low, high = faces
    span = float(ends[1, 0] - ends[0, 0])
    size = np.array([min(max(span, usual[0]), LONGEST_M), usual[1]])
    towards = np.clip(axes @ view_direction / CERTAIN_VIEW, -1.0, 1.0)
    near = np.where(towards > 0, low, high) * np.abs(towards) + (low + high) / 2 * (1.0 - np.abs(towards))
    middle = near + towards * size / 2
    whole_side = np.interp(span / usual[0], SEEN_LENGTH_SHARE, (0.0, 1.0))
    middle[0] += whole_side * (ends[:, 0].mean() - middle[0])
    centre = middle @ axes
    return float(centre[0]), float(centre[1]), float(size[0]), float(size[1]), float(heading)


def _ends_and_faces(ascending: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a vehicle ends, and where its faces lie, low and high (2, K), in sorted columns (N, K)."""
    both = _quantiles(ascending, END_QUANTILES + FACE_QUANTILES)
    return both[:2], both[2:]


def _quantiles(ascending: NDArray[np.float64], shares: tuple[float, ...]) -> NDArray[np.float64]:
    """Quantiles (S, K) of sorted columns (N, K), linear between ranks; np.quantile takes ten times as long."""
    rank = np.array(shares) * (len(ascending) - 1)
    below = rank.astype(np.int64)
    above = np.minimum(below + 1, len(ascending) - 1)
    part = (rank - below)[:, None]
    return np.asarray(ascending[below] * (1.0 - part) + ascending[above] * part)
