"""Which stored features a frame should have seen, and what it saw in their place."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera
from autowaze.world.pose import Pose, inverse, transform

_NEAR_M = 1.0
_DISPARITY_SIGMA_PX = 1.0  # of dense stereo at the silhouettes that decide here
_MARGIN_SIGMAS = 3.0
_MIN_MARGIN_M = 0.5  # a feature may lie that deep in what its pixel shows: mirrors, rims, foliage


class Sight(IntEnum):
    """What dense stereo says about the place of a stored feature."""

    UNKNOWN = 0
    """Stereo has no answer there."""
    HIDDEN = 1
    """Something stands in front of it."""
    SURFACE = 2
    """There is a surface at its depth."""
    THROUGH = 3
    """One sees through where it stood."""


def sight_of(
    points_map: NDArray[np.float64], T_map_cam: Pose, depth: NDArray[np.float32], camera: StereoCamera
) -> NDArray[np.uint8]:
    """Sight (N,) of map points through a dense depth map (H, W) in metres; `camera` is the depth map's.

    The four pixels around the projection must agree: a point counts as hidden when the farthest of them is nearer
    than it, as seen through when the nearest of them is farther; the margin grows with the square of the distance as
    stereo's error does. Points out of view are hidden.
    """
    points_cam = transform(inverse(T_map_cam), points_map)
    z = points_cam[:, 2]
    in_front = z > _NEAR_M
    uv = camera.project(np.where(in_front[:, None], points_cam, [0.0, 0.0, 1.0]))[:, :2]
    u0, v0 = np.floor(uv).astype(np.int64).T
    in_view = in_front & (u0 >= 0) & (v0 >= 0) & (u0 < camera.width - 1) & (v0 < camera.height - 1)
    u0, v0 = np.where(in_view, u0, 0), np.where(in_view, v0, 0)
    seen = np.stack([depth[v0, u0], depth[v0, u0 + 1], depth[v0 + 1, u0], depth[v0 + 1, u0 + 1]])
    valid = np.isfinite(seen)
    nearest = np.where(valid, seen, np.inf).min(axis=0)
    farthest = np.where(valid, seen, -np.inf).max(axis=0)
    margin = np.maximum(_MIN_MARGIN_M, _MARGIN_SIGMAS * _DISPARITY_SIGMA_PX * z**2 / camera.bf)
    sight = np.full(len(z), Sight.SURFACE, np.uint8)
    sight[farthest < z - margin] = Sight.HIDDEN
    sight[nearest > z + margin] = Sight.THROUGH
    sight[~valid.any(axis=0)] = Sight.UNKNOWN
    sight[~in_view] = Sight.HIDDEN
    return sight
