"""Pose by consensus: minimal samples of matches vote (RANSAC with P3P), for when there is no prediction."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera
from autowaze.world.pose import Pose, inverse, make_pose

_ERROR_PX = 4.0
_ITERATIONS, _CONFIDENCE = 1000, 0.999


def pose_by_consensus(
    position: NDArray[np.float64], uv: NDArray[np.floating], camera: StereoCamera, min_inliers: int
) -> tuple[Pose, NDArray[np.int64]] | None:
    """Camera pose (4, 4) that most matches agree on and the rows of those that do, or None.

    Args:
        position: (N, 3) map points, m. uv: (N, 2) the pixels at which they are thought to be seen.
        camera: calibration.
        min_inliers: fewer do not count.
    """
    if len(position) < max(min_inliers, 4):
        return None
    centre = position.mean(axis=0)  # keeps the numbers small in large maps
    found, rotation, translation, inliers = cv2.solvePnPRansac(
        position - centre,
        np.asarray(uv, dtype=np.float64),
        camera.K,
        None,
        iterationsCount=_ITERATIONS,
        reprojectionError=_ERROR_PX,
        confidence=_CONFIDENCE,
        flags=cv2.SOLVEPNP_AP3P,
    )
    if not found or inliers is None or len(inliers) < min_inliers:
        return None
    R = np.asarray(cv2.Rodrigues(rotation)[0], dtype=np.float64)
    T = inverse(make_pose(R, np.asarray(translation, dtype=np.float64).ravel()))
    T[:3, 3] += centre
    return T, inliers.ravel().astype(np.int64)
