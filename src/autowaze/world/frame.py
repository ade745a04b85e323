"""What the sensors deliver at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
"""(H, W) grey or (H, W, 3) BGR, uint8."""


@dataclass(frozen=True, slots=True)
class GnssFix:
    """A satellite fix: WGS84 degrees, metres; heading clockwise from north in radians where the receiver gives one."""

    lon_deg: float
    lat_deg: float
    altitude_m: float = 0.0
    horizontal_sigma_m: float = 3.0
    heading_rad: float | None = None


@dataclass(frozen=True)
class StereoFrame:
    """A rectified image pair. Timestamp in seconds since the epoch (UTC)."""

    index: int
    timestamp: float
    left: Image
    right: Image
    gnss: GnssFix | None = None

    @cached_property
    def left_grey(self) -> Image:
        """Left image as (H, W) uint8."""
        return to_grey(self.left)

    @cached_property
    def right_grey(self) -> Image:
        """Right image as (H, W) uint8."""
        return to_grey(self.right)


def to_grey(image: Image) -> Image:
    """Grey copy of a BGR image; a grey image comes back as it is."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
