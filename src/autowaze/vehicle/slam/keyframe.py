"""A frame that the map is built on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.world.pose import Pose


@dataclass
class Keyframe:
    """A frame of the drive.

    Attributes:
        index: number of the frame, counted from 1.
        T_map_cam: (4, 4).
        frame: its features.
        landmark_id: (N,) int64, the landmark of each; -1 for none.
        covariance: (6, 6) of the motion since the keyframe before: position (m) and rotation vector (rad) in the map.
        sigma_m: standard deviation of its position when it was made.
    """

    index: int
    T_map_cam: Pose
    frame: ObservedFrame
    landmark_id: NDArray[np.int64]
    covariance: NDArray[np.float64]
    sigma_m: float
