"""The semantic half of the car's pipeline (thesis, Fig. 3.2): segment, then track."""

from __future__ import annotations

from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import StereoFrame
from autowaze.world.instances import Detections, Tracks
from autowaze.world.pose import Pose


class SemanticPerception:
    """Segments every n-th frame, carries masks over the frames between, and keeps ids."""

    def __init__(self, segmenter: Segmenter, every_nth: int = 1, camera: StereoCamera | None = None) -> None:
        self.segmenter = segmenter
        self.every_nth = every_nth
        self.camera = camera

    def process(
        self, frame: StereoFrame, features: CameraFeatures | None = None, T_map_cam: Pose | None = None
    ) -> Tracks:
        """Instances of the next frame with their ids: `detect`, then `track`."""
        raise NotImplementedError

    def detect(self, frame: StereoFrame) -> Detections:
        """Instances of the next frame; needs nothing but the image, so it can run beside feature extraction."""
        raise NotImplementedError

    def track(
        self, detections: Detections, features: CameraFeatures | None = None, T_map_cam: Pose | None = None
    ) -> Tracks:
        """Ids for the detections of the frame; with features and a (predicted) pose, ids survive occlusion."""
        raise NotImplementedError
