"""The visible side of an instance as an upright rectangle in the map, so that its box can be foretold from elsewhere.

A plane's inverse depth is linear in the image, so the depths at the left and right edge of a box place the side of a
car that stands along the kerb as well as the back of one straight ahead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera
from autowaze.world.pose import Pose, inverse, transform

_NEAREST_M = 0.5  # corners closer to the image plane, or behind it, are taken to be here


def billboards(
    boxes: NDArray[np.floating], edge_depth: NDArray[np.floating], camera: StereoCamera, T_map_cam: Pose
) -> NDArray[np.float64]:
    """Corners (N, 4, 3) in map metres of boxes (N, 4) whose left and right edges are `edge_depth` (N, 2) m away."""
    left, top, right, bottom = np.asarray(boxes, dtype=np.float64).T
    u = np.stack([left, right, right, left], axis=1)
    v = np.stack([top, top, bottom, bottom], axis=1)
    depth = np.asarray(edge_depth, dtype=np.float64)[:, [0, 1, 1, 0]]
    corners = camera.back_project(np.stack([u, v], axis=2).reshape(-1, 2), depth.reshape(-1))
    return transform(T_map_cam, corners).reshape(-1, 4, 3)


def project_billboards(
    corners: NDArray[np.float64], camera: StereoCamera, T_map_cam: Pose
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Boxes (N, 4) that hold the corners (N, 4, 3), cut to the image, and mean depths (N,); NaN stays NaN."""
    points = transform(inverse(T_map_cam), corners.reshape(-1, 3))
    depth = points[:, 2].reshape(-1, 4).mean(axis=1)
    points[:, 2] = np.maximum(points[:, 2], _NEAREST_M)
    uv = camera.project(points)[:, :2].reshape(-1, 4, 2)
    limit = np.array([camera.width, camera.height], dtype=np.float64)
    low, high = np.clip(uv.min(axis=1), 0, limit), np.clip(uv.max(axis=1), 0, limit)
    return np.concatenate([low, high], axis=1), depth
