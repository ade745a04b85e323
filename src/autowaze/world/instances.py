"""Things seen in images: detections of one frame and tracks over frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.columns import Columns


@dataclass
class Detections(Columns):
    """Instances that a segmentation network found in one image, N rows (thesis, sec. 3.2.3).

    Attributes:
        box: (N, 4) float32, left, top, right, bottom in pixels of the full image.
        label: (N,) uint8, a `ClassLabel`.
        confidence: (N,) float32 in 0..1.
        mask: (N, H, W) bool, H and W those of the image.
    """

    box: NDArray[np.float32]
    label: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    mask: NDArray[np.bool_]

    @classmethod
    def empty(cls, height: int, width: int) -> Detections:
        """Nothing found in an image of this size."""
        return cls(
            np.zeros((0, 4), np.float32),
            np.zeros(0, np.uint8),
            np.zeros(0, np.float32),
            np.zeros((0, height, width), np.bool_),
        )


@dataclass
class Tracks(Columns):
    """Instances of one frame with identities that hold over frames, N rows.

    Attributes:
        id: (N,) int32, positive, never used twice in a drive.
        box, label, confidence, mask: as in `Detections`.
    """

    id: NDArray[np.int32]
    box: NDArray[np.float32]
    label: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    mask: NDArray[np.bool_]

    @classmethod
    def empty(cls, height: int, width: int) -> Tracks:
        """Nothing tracked in an image of this size."""
        d = Detections.empty(height, width)
        return cls(np.zeros(0, np.int32), d.box, d.label, d.confidence, d.mask)
