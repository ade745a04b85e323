"""Which landmarks a camera should see, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.vision.compiled import compiled
from autowaze.world.camera import StereoCamera
from autowaze.world.columns import Columns
from autowaze.world.pose import Pose, inverse

MIN_VIEW_COSINE = 0.5  # ORB-SLAM2: within 60 degrees of the mean viewing direction
NEAREST, FARTHEST = 0.8, 1.2  # ORB-SLAM2: margins on the distances between which the ORB scale can be detected
_FRONTAL_COSINE = 0.998


@dataclass
class Predictions(Columns):
    """Landmarks predicted in the image, M rows.

    Attributes:
        row: (M,) int64, rows of the landmark store.
        pixel: (M, 3) float64, u, v and disparity.
        level: (M,) int64, the pyramid level at which it should appear.
        frontal: (M,) bool, seen from nearly the direction from which it was seen before.
    """

    row: NDArray[np.int64]
    pixel: NDArray[np.float64]
    level: NDArray[np.int64]
    frontal: NDArray[np.bool_]


def predict(
    landmarks: Landmarks,
    rows: NDArray[np.int64],
    T_map_cam: Pose,
    camera: StereoCamera,
    level_scale: NDArray[np.float64],
) -> Predictions:
    """Landmarks of the given rows in the frustum, within their scale range and viewing angle."""
    T = inverse(T_map_cam)
    calibration = np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.bf])
    return Predictions(
        *_project(
            landmarks.position,
            landmarks.normal,
            landmarks.min_distance,
            landmarks.max_distance,
            rows,
            T,
            np.ascontiguousarray(T_map_cam[:3, 3]),
            calibration,
            camera.width,
            camera.height,
            np.log(level_scale[1] / level_scale[0]),
            len(level_scale) - 1,
        )
    )


@compiled
def _project(  # type: ignore[no-untyped-def]
    position, normal, min_distance, max_distance, rows, T_cam_map, centre, calibration, width, height, log_scale,
    max_level,
):  # fmt: skip
    """Row, pixel, level and whether it is seen frontally, of the visible ones."""
    n, m = rows.shape[0], 0
    row = np.empty(n, np.int64)
    pixel = np.empty((n, 3), np.float64)
    level = np.empty(n, np.int64)
    frontal = np.empty(n, np.bool_)
    fx, fy, cx, cy, bf = calibration[0], calibration[1], calibration[2], calibration[3], calibration[4]
    T = T_cam_map
    for i in range(n):
        r = rows[i]
        x, y, z = position[r, 0], position[r, 1], position[r, 2]
        zc = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if zc < 0.1:
            continue
        u = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / zc + cx
        v = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / zc + cy
        if u < 0.0 or u >= width or v < 0.0 or v >= height:
            continue
        dx, dy, dz = centre[0] - x, centre[1] - y, centre[2] - z
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        if distance < NEAREST * min_distance[r] or distance > FARTHEST * max_distance[r]:
            continue
        along = (dx * normal[r, 0] + dy * normal[r, 1] + dz * normal[r, 2]) / distance
        if along < MIN_VIEW_COSINE:
            continue
        predicted = np.int64(np.ceil(np.log(max_distance[r] / distance) / log_scale - 0.01))
        row[m], level[m], frontal[m] = r, min(max(predicted, 0), max_level), along > _FRONTAL_COSINE
        pixel[m, 0], pixel[m, 1], pixel[m, 2] = u, v, bf / zc
        m += 1
    return row[:m], pixel[:m], level[:m], frontal[:m]
