"""Segmentation of the part of an image that vehicles, people and cones can be in: what is high above them is sky."""

from __future__ import annotations

import numpy as np

from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.camera import StereoCamera
from autowaze.world.frame import Image
from autowaze.world.instances import Detections

_HIGHEST = np.tan(np.radians(20.0))
"""Above the optical axis. A van's roof is 13 degrees above the horizon at 4 m, a bus's at 8 m; and a camera looks some
degrees down, on a bumpy road or as it is mounted."""


class StreetView:
    """A segmenter that is spared the sky of tall images: on one of 16:9 with a wide lens a quarter of the work.

    Args:
        segmenter: what sees the rest.
        camera: that took the images, within a few degrees of level.
    """

    def __init__(self, segmenter: Segmenter, camera: StereoCamera) -> None:
        self._segmenter = segmenter
        self._rows = max(0, int(camera.cy - camera.fy * _HIGHEST))

    @property
    def name(self) -> str:
        """That of the segmenter."""
        return self._segmenter.name

    def segment(self, image: Image) -> Detections:
        """Confident instances, boxes and masks at image size, most confident first."""
        if self._rows == 0:
            return self._segmenter.segment(image)
        seen = self._segmenter.segment(np.ascontiguousarray(image[self._rows :]))
        mask = np.zeros((len(seen), *image.shape[:2]), np.bool_)
        mask[:, self._rows :] = seen.mask
        down = np.array([0, self._rows, 0, self._rows], np.float32)
        return Detections(seen.box + down, seen.label, seen.confidence, mask)
