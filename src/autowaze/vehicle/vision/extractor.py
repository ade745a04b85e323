"""The thesis's feature extraction: a stereo frame in, camera features out."""

from __future__ import annotations

from autowaze.vehicle.vision.settings import VisionSettings
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import StereoFrame


class FeatureExtractor:
    """ORB features of both images, in two threads, and the depth of the left ones."""

    def __init__(self, camera: StereoCamera, settings: VisionSettings = VisionSettings()) -> None:  # noqa: B008
        self.camera = camera
        self.settings = settings

    def extract(self, frame: StereoFrame) -> CameraFeatures:
        """Features of the left image, with depth and position where the right image shows them too."""
        raise NotImplementedError
