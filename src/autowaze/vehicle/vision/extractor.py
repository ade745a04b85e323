"""The thesis's feature extraction: a stereo frame in, camera features out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from autowaze.vehicle.vision.orb import OrbDetector
from autowaze.vehicle.vision.pyramid import PyramidLayout
from autowaze.vehicle.vision.settings import VisionSettings
from autowaze.vehicle.vision.stereo import match_stereo
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import StereoFrame


class FeatureExtractor:
    """ORB features of both images, in two threads, and the depth of the left ones."""

    def __init__(self, camera: StereoCamera, settings: VisionSettings = VisionSettings()) -> None:  # noqa: B008
        self.camera = camera
        self.settings = settings
        s = settings
        layout = PyramidLayout.of(camera.width, camera.height, s.n_levels, s.scale_factor)
        self._left = OrbDetector(s.n_features, layout, s.fast_threshold)
        self._right = OrbDetector(s.n_features_right, layout, s.fast_threshold)
        self._right_thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="right-image")

    def extract(self, frame: StereoFrame) -> CameraFeatures:
        """Features of the left image, with depth and position where the right image shows them too."""
        right_pending = self._right_thread.submit(self._right.detect, frame.right_grey)
        left = self._left.detect(frame.left_grey)
        right = right_pending.result()
        u_right = match_stereo(
            left,
            right,
            self._left.pyramid,
            self._right.pyramid,
            min_disparity_px=self.settings.min_disparity_px,
            max_disparity_px=self.camera.bf / self.settings.min_depth_m,
            max_hamming=self.settings.max_hamming,
            helper=self._right_thread,
        )
        depth = (self.camera.bf / (left.uv[:, 0] - u_right)).astype(np.float32)
        return CameraFeatures(
            uv=left.uv,
            octave=left.octave,
            angle=left.angle,
            descriptor=left.descriptor,
            u_right=u_right,
            depth=depth,
            position_cam=self.camera.back_project(left.uv, depth).astype(np.float32),
            label=np.zeros(len(left), np.uint8),
            instance_id=np.zeros(len(left), np.int32),
        )
