"""The thesis's feature extraction: a stereo frame in, camera features out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from autowaze.vehicle.vision.corners import Corners
from autowaze.vehicle.vision.orb import OrbDetector
from autowaze.vehicle.vision.pyramid import Pyramid, PyramidLayout
from autowaze.vehicle.vision.settings import VisionSettings
from autowaze.vehicle.vision.stereo import NEAR_BASELINES, match_stereo
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import StereoFrame


class FeatureExtractor:
    """ORB features of the left image, their depth from the right one; two threads share the work."""

    def __init__(self, camera: StereoCamera, settings: VisionSettings = VisionSettings()) -> None:  # noqa: B008
        self.camera = camera
        self.settings = settings
        s = settings
        layout = PyramidLayout.of(camera.width, camera.height, s.n_levels, s.scale_factor)
        self._left = OrbDetector(s.n_features, layout, s.fast_threshold)
        self._right = Pyramid(layout)
        self._helper = ThreadPoolExecutor(max_workers=1, thread_name_prefix="features")

    def extract(self, frame: StereoFrame) -> CameraFeatures:
        """Features of the left image, with depth and position where the right image shows them too."""
        right_ready = self._helper.submit(self._right.fill, frame.right_grey)
        corners = self._left.detect(frame.left_grey, self._helper)
        right_ready.result()
        second = self._helper.submit(self._features_of, corners[1::2])
        return CameraFeatures.concatenate([self._features_of(corners[::2]), second.result()])

    def _features_of(self, corners: Corners) -> CameraFeatures:
        keypoints = self._left.describe(corners)
        limits = self.settings.min_disparity_px, self.camera.bf / self.settings.min_depth_m
        near_px = self.camera.fx / NEAR_BASELINES
        disparity = match_stereo(corners, self._left.pyramid, self._right, *limits, near_px)
        depth = (self.camera.bf / disparity).astype(np.float32)
        return CameraFeatures(
            uv=keypoints.uv,
            octave=keypoints.octave,
            angle=keypoints.angle,
            descriptor=keypoints.descriptor,
            u_right=keypoints.uv[:, 0] - disparity,
            depth=depth,
            position_cam=self.camera.back_project(keypoints.uv, depth).astype(np.float32),
            label=np.zeros(len(keypoints), np.uint8),
            instance_id=np.zeros(len(keypoints), np.int32),
        )
