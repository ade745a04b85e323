"""Stereo SLAM: features in, pose out, landmarks kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.local_mapper import LocalMapper
from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.vehicle.slam.pose_optimization import PoseEstimate
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.vehicle.slam.tracker import Located, Tracker
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import Pose, heading_to_rotation, inverse, make_pose, so3_log


class StereoSlam:
    """Localises a stereo camera in a stored map, by visual odometry where there is none."""

    def __init__(
        self,
        camera: StereoCamera,
        settings: SlamSettings = SlamSettings(),  # noqa: B008
        stored_map: FeatureMap | None = None,
        T_map_start: Pose | None = None,
        position_prior: tuple[NDArray[np.float64], float] | None = None,
    ) -> None:
        self.camera = camera
        self.settings = settings
        self.landmarks = Landmarks()
        if stored_map is not None:
            self.landmarks.add_stored(stored_map.features)
        self.T_start = make_pose(heading_to_rotation(0.0), np.zeros(3)) if T_map_start is None else T_map_start
        self.mapper = LocalMapper(camera, settings, self.landmarks)
        self.tracker = Tracker(camera, settings, self.landmarks)
        self._last: Located | None = None
        self._velocity: Pose = np.eye(4)
        self._reference_inliers = 0
        self._count = 0

    def track(
        self,
        features: CameraFeatures,
        timestamp: float,
        index: int,
        gnss_position: NDArray[np.float64] | None = None,
        moving: NDArray[np.bool_] | None = None,
    ) -> TrackedFrame:
        """Pose of the next frame."""
        s = self.settings
        frame = ObservedFrame(features, self.camera, s.level_scale, (s.corner_sigma_px, s.disparity_sigma_px), moving)
        self._count += 1
        if self._last is None:
            return self._begin(frame, timestamp, index)
        moved = self.mapper.adopt(self._count)
        if moved is not None:
            e = self._last.estimate
            object.__setattr__(e, "T_map_cam", moved @ e.T_map_cam)
        last = self._last
        T_predicted = last.T_map_cam @ self._velocity
        T = self.tracker.from_last(frame, last, T_predicted)
        if T is None:
            print(index, "motion failed")
            T = T_predicted
        located = self.tracker.in_map(frame, T, self.mapper.local_rows)
        self._velocity = inverse(last.T_map_cam) @ located.T_map_cam
        self.count_seen(located, timestamp)
        ids = located.landmark_id
        visible = self.landmarks.id[located.visible_row]
        if self._wants_keyframe(located):
            ids = self.mapper.insert(frame, located.T_map_cam, ids, self._count, timestamp)
            self._reference_inliers = int((ids >= 0).sum())
            located = Located(frame, located.estimate, ids, located.visible_row, located.n_inliers, located.n_stored_inliers)
        self._last = located
        return TrackedFrame(index, timestamp, TrackingState.ODOMETRY, "", located.T_map_cam, located.estimate.covariance,
            located.n_inliers, located.n_stored_inliers, ids, visible)

    def count_seen(self, located: Located, timestamp: float) -> None:
        self.landmarks.n_visible[located.visible_row] += 1
        rows = self.landmarks.rows(located.landmark_id)
        f = rows >= 0
        r = rows[f]
        self.landmarks.n_found[r] += 1
        self.landmarks.last_seen[r] = timestamp
        self.landmarks.label[r] = located.frame.features.label[f]
        self.landmarks.instance[r] = located.frame.features.instance_id[f]

    def _wants_keyframe(self, located: Located) -> bool:
        if self.mapper.is_adjusting: return False
        kf = self.mapper.keyframes[-1]
        if self._count - kf.index < self.settings.min_keyframe_gap: return False
        d = inverse(kf.T_map_cam) @ located.T_map_cam
        return bool(located.n_inliers < self.settings.keyframe_ratio * self._reference_inliers
           or np.linalg.norm(d[:3, 3]) > self.settings.keyframe_distance_m
           or np.linalg.norm(so3_log(d[:3, :3])) > self.settings.keyframe_angle_rad)

    def _begin(self, frame, timestamp, index) -> TrackedFrame:
        ids = np.full(len(frame), -1, np.int64)
        ids = self.mapper.insert(frame, self.T_start, ids, self._count, timestamp)
        est = PoseEstimate(self.T_start, np.zeros((6, 6)), np.zeros(0, bool), np.zeros(0))
        self._last = Located(frame, est, ids, np.zeros(0, np.int64), int((ids >= 0).sum()), 0)
        self._reference_inliers = int((ids >= 0).sum())
        return TrackedFrame(index, timestamp, TrackingState.ODOMETRY, "", self.T_start, np.zeros((6, 6)), self._reference_inliers, 0, ids,
           np.zeros(0, np.int64))

    def finish(self) -> None:
        """Wait for the bundle adjustment under way and apply it."""
        self.mapper.finish()
