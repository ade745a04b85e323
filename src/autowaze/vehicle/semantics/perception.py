"""The semantic half of the car's pipeline (thesis, Fig. 3.2): segment, then track."""

from __future__ import annotations

from numpy.typing import ArrayLike

from autowaze.vehicle.semantics.instance_depth import measure_depths
from autowaze.vehicle.semantics.propagation import propagate
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.vehicle.semantics.sort import Sort
from autowaze.vehicle.semantics.sort_settings import SortSettings
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import Image, StereoFrame
from autowaze.world.instances import Detections, Tracks
from autowaze.world.pose import Pose


class SemanticPerception:
    """Segments every n-th frame, carries masks over the frames between, and keeps ids.

    `detect` needs nothing but the image and can run beside feature extraction; `track` follows it. Given the frame's
    features and its pose, or the pose foretold, ids survive large image motion and occlusion; without them tracking
    is plain SORT.
    """

    def __init__(
        self,
        segmenter: Segmenter,
        every_nth: int = 1,
        camera: StereoCamera | None = None,
        settings: SortSettings | None = None,
    ) -> None:
        self.segmenter = segmenter
        self.every_nth = every_nth
        self.camera = camera
        self._sort = Sort(camera, settings)
        self._count = 0
        self._last: tuple[Image, Detections] | None = None

    def process(
        self, frame: StereoFrame, features: CameraFeatures | None = None, T_map_cam: Pose | None = None
    ) -> Tracks:
        """Instances of the next frame with their ids: `detect`, then `track`."""
        return self.track(self.detect(frame), features, T_map_cam)

    def detect(self, frame: StereoFrame) -> Detections:
        """Instances of the next frame."""
        if self._last is None or self._count % self.every_nth == 0:
            detections = self.segmenter.segment(frame.left)
        else:
            image, earlier = self._last
            detections = propagate(earlier, image, frame.left_grey)
        self._count += 1
        self._last = frame.left_grey, detections
        return detections

    def track(
        self,
        detections: Detections,
        features: CameraFeatures | None = None,
        T_map_cam: Pose | None = None,
        moving_ids: ArrayLike = (),
    ) -> Tracks:
        """Ids for the detections of the frame, given those of the tracks known to move."""
        depths = measure_depths(features, detections) if features is not None else None
        return self._sort.update(detections, T_map_cam, depths, moving_ids)
