"""When a frame becomes a keyframe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.keyframe import Keyframe
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.tracker import Located
from autowaze.world.pose import inverse, so3_log


class KeyframePolicy:
    """Keyframes follow the motion, and come sooner where landmarks go out of sight, as on turns."""

    def __init__(self, settings: SlamSettings) -> None:
        self.settings = settings
        self._reference_inliers = 0

    def wants(self, located: Located, newest: Sequence[Keyframe]) -> bool:
        """Whether the frame should be a keyframe, given the newest one, if there is any."""
        if not newest:
            return True
        moved = inverse(newest[-1].T_map_cam) @ located.T_map_cam
        return bool(
            located.n_inliers < self.settings.keyframe_ratio * self._reference_inliers
            or np.linalg.norm(moved[:3, 3]) > self.settings.keyframe_distance_m
            or np.linalg.norm(so3_log(moved[:3, :3])) > self.settings.keyframe_angle_rad
        )

    def took(self, landmark_id: NDArray[np.int64]) -> None:
        """A keyframe was made, with these landmarks (N,); -1 for none."""
        self._reference_inliers = int(np.count_nonzero(landmark_id >= 0))
