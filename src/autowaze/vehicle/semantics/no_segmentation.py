"""A car without a segmentation model."""

from __future__ import annotations

from autowaze.world.frame import Image
from autowaze.world.instances import Detections


class NoSegmentation:
    """Finds nothing, so nothing is told apart: the cloud is left with what the car saw of the ground.

    It takes the place of a network where none is at hand. The thesis's method cannot work without instances; `fused`
    decides by free ground and obstacles alone, and takes what moves for what stands.
    """

    name = "none"

    def segment(self, image: Image) -> Detections:
        """No instances."""
        return Detections.empty(*image.shape[:2])
