"""Where spots lie and how vehicles stand in them."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray


def measured(polygons: NDArray[np.object_]) -> tuple[NDArray[np.float64], ...]:
    """Bounds (N, 4), centre (N, 2), length, width and heading (N,) of outlines, metres and radians.

    Length and width are the sides of the smallest rectangle around each, the heading is the longer side's compass
    heading: how a vehicle stands in it.
    """
    centre = np.column_stack([shapely.get_x(c := shapely.centroid(polygons)), shapely.get_y(c)])
    rectangles = shapely.minimum_rotated_rectangle(polygons)
    corners = np.array([shapely.get_coordinates(p)[:4] for p in rectangles]).reshape(-1, 4, 2)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]
    sides = np.stack([np.hypot(*first.T), np.hypot(*second.T)])
    longer = np.where((sides[0] >= sides[1])[:, None], first, second)
    heading = np.arctan2(longer[:, 0], longer[:, 1]) % np.pi
    return shapely.bounds(polygons), centre, sides.max(axis=0), sides.min(axis=0), heading
