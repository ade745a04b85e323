"""SORT: simple online and realtime tracking (Bewley et al. 2016), and what a moving stereo camera adds to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections, Tracks
from autowaze.world.pose import Pose


class Sort:
    """Gives detections ids that hold over frames."""

    def __init__(self, camera: StereoCamera | None = None) -> None:
        self.camera = camera

    def update(
        self,
        detections: Detections,
        T_map_cam: Pose | None = None,
        edge_depth: NDArray[np.floating] | None = None,
    ) -> Tracks:
        """Tracks of the next frame.

        Args:
            detections: instances of the frame.
            T_map_cam: pose of the frame or its prediction; None for plain SORT.
            edge_depth: (N, 2) depth in metres of each detection's surface at the left and at the right edge of its
                box (`association.edge_depths`); NaN where unknown.
        """
        raise NotImplementedError
