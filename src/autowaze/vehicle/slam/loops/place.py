"""A keyframe that is remembered: where it was, and what it saw of things that stay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.keyframe import Keyframe
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.world.features import CameraFeatures
from autowaze.world.labels import is_movable
from autowaze.world.pose import Pose, inverse, transform


@dataclass
class Place:
    """One place of a drive.

    Attributes:
        index: number of its frame, counted from 1.
        T_map_cam: (4, 4), as it is known today.
        path_m: length of the way from the first place.
        T_before: (4, 4) pose in the camera of the place before, by odometry (of the first, itself).
        covariance: (6, 6) of that motion: position (m) and rotation vector (rad) in the camera of the place before.
        sigma_m: standard deviation of its position in the map when it was seen.
        features: N features that do not move and cannot drive away.
        landmark_id: (N,) int64, their landmarks.
        position_cam: (N, 3) float64, those landmarks in its camera, m.
    """

    index: int
    T_map_cam: Pose
    path_m: float
    T_before: Pose
    covariance: NDArray[np.float64]
    sigma_m: float
    features: CameraFeatures
    landmark_id: NDArray[np.int64]
    position_cam: NDArray[np.float64]

    def forget(self) -> None:
        """Keep the pose alone."""
        self.features = CameraFeatures.empty()
        self.landmark_id = np.zeros(0, np.int64)
        self.position_cam = np.zeros((0, 3))


def remembered(
    keyframe: Keyframe, landmarks: Landmarks, n_features: int
) -> tuple[CameraFeatures, NDArray[np.int64], NDArray[np.float64]]:
    """Features worth remembering of a keyframe: those with depth whose landmarks most keyframes saw.

    Returns them with their landmark ids (N,) and those landmarks' positions (N, 3) in the keyframe's camera.
    """
    features = keyframe.frame.features
    row = landmarks.rows(keyframe.landmark_id)
    stays = ~is_movable(features.label) & ~keyframe.frame.moving
    kept = np.flatnonzero(features.has_depth & stays & (row >= 0))
    order = np.argsort(-landmarks.n_observations[row[kept]], kind="stable")
    kept = np.sort(kept[order[:n_features]])
    position = transform(inverse(keyframe.T_map_cam), landmarks.position[row[kept]])
    return features[kept], keyframe.landmark_id[kept], position
