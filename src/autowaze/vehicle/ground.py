"""The ground that the car saw: free, obstacle or unseen, from half-size dense stereo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera
from autowaze.world.frame import StereoFrame
from autowaze.world.ground import GroundCells
from autowaze.world.pose import Pose


@dataclass(frozen=True, slots=True)
class GroundSettings:
    """What can be set about the ground grid."""

    max_range_m: float = 22.0


@dataclass(frozen=True)
class GroundObservation:
    """What one frame saw of the ground.

    Attributes:
        ix, iy: (N,) int32 cells of the map's ground plane, `CELL_M` wide.
        free, obstacle: (N,) bool, never both.
        depth: (H / 2, W / 2) float32 metres along the optical axis of the left camera scaled by one half; NaN where
            stereo has no answer.
        camera: the scaled camera that the depth map belongs to.
    """

    ix: NDArray[np.int32]
    iy: NDArray[np.int32]
    free: NDArray[np.bool_]
    obstacle: NDArray[np.bool_]
    depth: NDArray[np.float32]
    camera: StereoCamera


class GroundObserver:
    """Sees the ground of one stereo frame."""

    def __init__(self, camera: StereoCamera, settings: GroundSettings = GroundSettings()) -> None:  # noqa: B008
        self.camera = camera
        self.settings = settings

    def observe(
        self, frame: StereoFrame, T_map_cam: Pose, instances_moving_mask: NDArray[np.bool_] | None = None
    ) -> GroundObservation:
        """Cells and depth of one frame; pixels of the mask (H, W) do not vote."""
        raise NotImplementedError


class GroundGrid:
    """Votes of the frames of a window."""

    def add(self, observation: GroundObservation) -> None:
        """Count one frame's cells."""
        raise NotImplementedError

    def cells(self) -> GroundCells:
        """Votes so far, sorted by cell."""
        raise NotImplementedError

    def clear(self) -> None:
        """Start the next window."""
        raise NotImplementedError
