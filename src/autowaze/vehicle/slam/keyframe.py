"""A frame that the map is built on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.world.pose import Pose


@dataclass
class Keyframe:
    """Attributes: index of the frame; its pose (4, 4); its features; the landmark id of each (N,), -1 for none."""

    index: int
    T_map_cam: Pose
    frame: ObservedFrame
    landmark_id: NDArray[np.int64]

    @property
    def observed_ids(self) -> NDArray[np.int64]:
        """Landmarks it sees."""
        return self.landmark_id[self.landmark_id >= 0]
