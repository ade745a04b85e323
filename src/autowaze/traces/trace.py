"""What every source of stereo drives offers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera
from autowaze.world.frame import StereoFrame


@dataclass(frozen=True)
class GroundTruth:
    """What evaluation may look at and the system never does.

    Attributes:
        T_world_cam: poses (N, 4, 4) of the left camera, metres, in the trace's own ground-truth frame
            (for KITTI: x right, y down, z forward of the first reference camera).
        in_map_frame: whether that frame is the map's, east-north-up about the parking map's georeference.
    """

    T_world_cam: NDArray[np.float64]
    in_map_frame: bool = False


class Trace(Protocol):
    """A recorded stereo drive: `for frame in trace`, `trace[17]`, `len(trace)`."""

    @property
    def name(self) -> str:
        """Short name for tables and files."""

    @property
    def camera(self) -> StereoCamera:
        """Calibration of the rectified pair."""

    @property
    def ground_truth(self) -> GroundTruth | None:
        """Truth for evaluation, if the source has it."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> StereoFrame: ...

    def __iter__(self) -> Iterator[StereoFrame]: ...
