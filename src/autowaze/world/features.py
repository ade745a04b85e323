"""Features of one stereo frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.columns import Columns

DESCRIPTOR_BYTES = 32  # ORB: 256 binary tests
LEVEL_SCALE = 1.2  # of one level of the image pyramid over the next finer one (ORB-SLAM2)


@dataclass
class CameraFeatures(Columns):
    """ORB features of a stereo pair, N rows (thesis, sec. 3.2.2).

    Attributes:
        uv: left pixel (N, 2) float32.
        octave: pyramid level (N,) uint8; the level's scale is `LEVEL_SCALE` ** octave.
        angle: orientation (N,) float32, radians.
        descriptor: (N, 32) uint8.
        u_right: column in the right image (N,) float32; NaN without a stereo match.
        depth: (N,) float32, metres along the optical axis; NaN without a stereo match.
        position_cam: (N, 3) float32, metres in the left camera frame; NaN without a stereo match.
        label: class (N,) uint8, a `ClassLabel`; background until associated with instances.
        instance_id: (N,) int32, the track's positive id; 0 for none.
    """

    uv: NDArray[np.float32]
    octave: NDArray[np.uint8]
    angle: NDArray[np.float32]
    descriptor: NDArray[np.uint8]
    u_right: NDArray[np.float32]
    depth: NDArray[np.float32]
    position_cam: NDArray[np.float32]
    label: NDArray[np.uint8]
    instance_id: NDArray[np.int32]

    @property
    def has_depth(self) -> NDArray[np.bool_]:
        """Rows with a stereo match."""
        return np.isfinite(self.depth)

    @property
    def scale(self) -> NDArray[np.float64]:
        """Size (N,) of a pixel of each one's pyramid level, in pixels of the image."""
        return np.asarray(LEVEL_SCALE ** self.octave.astype(np.float64))

    @classmethod
    def empty(cls) -> CameraFeatures:
        """No features."""
        f32 = np.float32
        return cls(
            uv=np.zeros((0, 2), f32),
            octave=np.zeros(0, np.uint8),
            angle=np.zeros(0, f32),
            descriptor=np.zeros((0, DESCRIPTOR_BYTES), np.uint8),
            u_right=np.zeros(0, f32),
            depth=np.zeros(0, f32),
            position_cam=np.zeros((0, 3), f32),
            label=np.zeros(0, np.uint8),
            instance_id=np.zeros(0, np.int32),
        )
