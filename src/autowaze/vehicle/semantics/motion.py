"""Parked or moving, by how an instance's features move in the map frame once the car's own motion is taken out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera
from autowaze.world.columns import Columns
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import Pose


@dataclass
class Motions(Columns):
    """Motion of the instances of one frame, N rows.

    Attributes:
        id: (N,) int32, the track's id.
        label: (N,) uint8, a `ClassLabel`.
        moving: (N,) bool.
        position: (N, 2) float32, median of the instance's features, metres in the map frame.
        velocity: (N, 2) float32, m/s in the map frame; zero for what stands.
    """

    id: NDArray[np.int32]
    label: NDArray[np.uint8]
    moving: NDArray[np.bool_]
    position: NDArray[np.float32]
    velocity: NDArray[np.float32]


class MotionClassifier:
    """Tells moving instances from parked ones."""

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera

    def update(self, features: CameraFeatures, T_map_cam: Pose, timestamp: float) -> Motions:
        """Motion of every instance that has features with depth in this frame."""
        raise NotImplementedError

    @property
    def moving_ids(self) -> NDArray[np.int32]:
        """Ids judged moving so far, sorted; serves the next frame before its pose is known."""
        raise NotImplementedError
