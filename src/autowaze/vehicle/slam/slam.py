"""Stereo SLAM: features in, pose out, landmarks kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import Pose


class StereoSlam:
    """Localises a stereo camera in a stored map, by visual odometry where there is none."""

    def __init__(
        self,
        camera: StereoCamera,
        settings: SlamSettings = SlamSettings(),  # noqa: B008
        stored_map: FeatureMap | None = None,
        T_map_start: Pose | None = None,
        position_prior: tuple[NDArray[np.float64], float] | None = None,
    ) -> None:
        self.camera = camera
        self.settings = settings
        self.landmarks = Landmarks()

    def track(
        self,
        features: CameraFeatures,
        timestamp: float,
        index: int,
        gnss_position: NDArray[np.float64] | None = None,
        moving: NDArray[np.bool_] | None = None,
    ) -> TrackedFrame:
        """Pose of the next frame."""
        raise NotImplementedError

    def finish(self) -> None:
        """Wait for the bundle adjustment under way and apply it."""
        raise NotImplementedError
