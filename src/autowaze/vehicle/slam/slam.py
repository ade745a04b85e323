"""Stereo SLAM: features in, pose out, landmarks kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.gnss_constraint import GnssConstraint, GnssPosition
from autowaze.vehicle.slam.keyframe import Keyframe
from autowaze.vehicle.slam.keyframe_policy import KeyframePolicy
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.local_mapper import LocalMapper
from autowaze.vehicle.slam.loops.closer import LoopCloser
from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.vehicle.slam.pose_uncertainty import PoseUncertainty
from autowaze.vehicle.slam.relocalizer import START_SIGMA_M, PositionPrior, Relocalizer, prior_of_fix
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState, judged
from autowaze.vehicle.slam.tracker import Located, Tracker
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import Pose, heading_to_rotation, inverse, make_pose

_BLIND_STEP_M = 1.0  # assumed per frame while lost
_UNKNOWN = np.diag([1e6, 1e6, 1e6, 10.0, 10.0, 10.0])
_MAX_BLIND_FRAMES = 10  # a motion is carried on so long without sight


class StereoSlam:
    """Localises a stereo camera in a stored map, by visual odometry where there is none.

    Args:
        camera: calibration of the rectified pair.
        settings: see `SlamSettings`.
        stored_map: the map to localise in; its features stay where they are.
        T_map_start: (4, 4) pose of the first frame, where it is known. Without one and without a stored map the drive
            begins at the origin, level and heading north.
        position_prior: map position (3,) and standard deviation in metres of the first frame; None searches the whole
            map, if it is small.
        start_sigma: standard deviations of `T_map_start`, metres and radians of heading; satellite fixes mend it.

    Attributes:
        landmarks: all features held on to, see `Landmarks`.
        loops: the places of the drive and the loops that it closed; without a stored map alone, which holds the pose
            itself.
    """

    def __init__(
        self,
        camera: StereoCamera,
        settings: SlamSettings = SlamSettings(),  # noqa: B008
        stored_map: FeatureMap | None = None,
        T_map_start: Pose | None = None,
        position_prior: PositionPrior | None = None,
        start_sigma: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.camera = camera
        self.settings = settings
        self.landmarks = Landmarks()
        self._has_map = stored_map is not None and len(stored_map) > 0
        if stored_map is not None:
            self.landmarks.add_stored(stored_map.features)
        self._T_start = T_map_start
        self._prior = position_prior
        if position_prior is None and T_map_start is not None:
            self._prior = (T_map_start[:3, 3], START_SIGMA_M)
        self._keyframe_policy = KeyframePolicy(settings)
        self._mapper = LocalMapper(camera, settings, self.landmarks)
        self._tracker = Tracker(camera, settings, self.landmarks)
        self._relocalizer = Relocalizer(camera, settings, self.landmarks, self._tracker)
        self._level_scale = settings.level_scale
        self._last: Located | None = None
        self._velocity: Pose | None = None
        self.loops = LoopCloser(camera, settings)
        self._uncertainty = PoseUncertainty()
        self._since_keyframe = PoseUncertainty()
        self._gnss = GnssConstraint(start_sigma)
        self._count = 0
        self._blind_frames = 0
        self._seeing_but_lost = 0

    def track(
        self,
        features: CameraFeatures,
        timestamp: float,
        index: int,
        fix: GnssPosition | None = None,
        moving: NDArray[np.bool_] | None = None,
    ) -> TrackedFrame:
        """Pose of the next frame.

        Args:
            features: of the frame, with labels and instances where they are known.
            timestamp: seconds since the epoch. index: number of the frame.
            fix: of a satellite receiver; helps to find a lost place, and holds odometry where there is no stored map.
            moving: (N,) features on things known to move; they neither steer the pose nor become landmarks.
        """
        frame = self._observe(features, moving)
        self._count += 1
        self._apply_adjustment()
        if self._last is None:
            return self._begin(frame, timestamp, index, fix)
        located, reason = self._follow(frame), ""
        if located is None:
            located, reason = self._find_again(frame, fix)
        if located is None:
            return self._lost(frame, timestamp, index, reason)
        return self._found(located, timestamp, index, reason, fix)

    def foretell(self, features: CameraFeatures) -> Pose | None:
        """Where the next frame was taken, by the last one alone; None before the first.

        For what has to be known before the features have their labels and `track` is called. Changes nothing.
        """
        last = self._last
        return None if last is None else self._tracker.first_look(self._observe(features, None), last, self._velocity)

    def replace_stored_features(self, added: MapFeatures, removed: NDArray[np.uint64]) -> None:
        """Change the stored map between two frames: take out these ids (R,), then put these features in.

        The bundle adjustment under way is applied first, for it knows nothing of the change.
        """
        moved = self._mapper.finish()
        if moved is not None and self._last is not None:
            self._last = self._last.moved(moved)
        outdated = np.concatenate([removed, added.id])
        self.landmarks.remove(self.landmarks.is_stored & np.isin(self.landmarks.map_id, outdated))
        self.landmarks.add_stored(added)
        self._has_map = bool(self.landmarks.is_stored.any())
        if self._last is not None:
            self._mapper.refresh_local(self._last.T_map_cam)

    def finish(self) -> None:
        """Wait for the bundle adjustment under way and apply it; look for loops to the end.

        Those correct the places of the drive, see `DriveCorrection`, and no pose or landmark that was told already.
        """
        self._mapper.finish()
        if not self._has_map:
            self._mapper.forget()
            self.loops.remember(self._mapper.take_retired(), self.landmarks)
            self.loops.finish()

    def _observe(self, features: CameraFeatures, moving: NDArray[np.bool_] | None) -> ObservedFrame:
        s = self.settings
        sigma_px = (s.corner_sigma_px, s.disparity_sigma_px)
        return ObservedFrame(features, self.camera, self._level_scale, sigma_px, s.close_baselines, moving)

    def _apply_adjustment(self) -> None:
        moved = self._mapper.adopt(self._count)
        if moved is not None and self._last is not None:
            self._last = self._last.moved(moved)
        corrected = self.loops.adopt(self._count)
        if corrected is not None and self._last is not None:
            self._mapper.move(corrected.motion)
            self._last = self._last.moved(corrected.motion)
            if corrected.covariance is not None:
                self._uncertainty.become(corrected.covariance)

    def _begin(self, frame: ObservedFrame, timestamp: float, index: int, fix: GnssPosition | None) -> TrackedFrame:
        """First frames: found in the stored map, or made the first keyframe."""
        is_mapped = self._has_map
        if self._has_map:
            rows = self._relocalizer.stored_rows(self._prior or prior_of_fix(fix))
            located = self._relocalizer.locate(frame, rows, None if self._T_start is None else self._T_start[:3, :3])
            if located is not None:
                return self._found(located, timestamp, index, "")
            is_mapped = self._T_start is None or len(rows) >= self.settings.min_stored_inliers
        n_stereo = int(np.count_nonzero(frame.features.has_depth & ~frame.moving))
        if n_stereo < self.settings.min_start_features:
            return self._nowhere(frame, timestamp, index, f"only {n_stereo} stereo features to start from")
        if not is_mapped:
            T = make_pose(heading_to_rotation(0.0), np.zeros(3)) if self._T_start is None else self._T_start
            return self._found(Located.at(frame, T), timestamp, index, "")
        self._seeing_but_lost += 1
        if self._T_start is None or self._seeing_but_lost < self.settings.restart_after:
            return self._nowhere(frame, timestamp, index, "not found in the stored map yet")
        covariance = np.diag([START_SIGMA_M**2] * 3 + [0.1] * 3)
        self._uncertainty.widen(covariance)
        reason = "not found in the stored map; odometry from the given start"
        here = self._T_start[:3, 3] if fix is None else fix.position  # it has driven on since the start was given
        return self._found(Located.at(frame, make_pose(self._T_start[:3, :3], here)), timestamp, index, reason)

    def _follow(self, frame: ObservedFrame) -> Located | None:
        """Pose by prediction from the last frame, or None."""
        if self._last is None or self._blind_frames:
            return None
        T = self._tracker.first_look(frame, self._last, self._velocity)
        if T is None:
            return None
        located = self._tracker.in_map(frame, T, self._mapper.local_rows)
        return located if located.n_steering >= self.settings.min_inliers else None

    def _find_again(self, frame: ObservedFrame, fix: GnssPosition | None) -> tuple[Located | None, str]:
        """After a loss: the same place by appearance, or a fresh start of odometry when none is known."""
        assert self._last is not None
        n_stereo = int(np.count_nonzero(frame.features.has_depth & ~frame.moving))
        if n_stereo < self.settings.min_start_features:
            return None, f"only {n_stereo} stereo features in view"
        sigma = 1.0 + 0.3 * self._blind_m()
        prior = prior_of_fix(fix) or (self._last.T_map_cam[:3, 3], sigma)
        located = self._relocalizer.locate(frame, self._relocalizer.rows_near(prior), self._last.T_map_cam[:3, :3])
        if located is not None:
            return located, "found again"
        self._seeing_but_lost += 1
        if self._seeing_but_lost < self.settings.restart_after:
            return None, "the view matches no known place"
        self._mapper.forget()
        unseen = np.diag([self._blind_m() ** 2] * 3 + [0.1] * 3)
        self._uncertainty.widen(unseen)
        self._since_keyframe.widen(unseen)
        return Located.at(frame, self._last.T_map_cam), "odometry started afresh after a loss"

    def _found(
        self, located: Located, timestamp: float, index: int, reason: str, fix: GnssPosition | None = None
    ) -> TrackedFrame:
        before = None if self._blind_frames else self._last
        self._velocity = None if before is None else inverse(before.T_map_cam) @ located.T_map_cam
        self._blind_frames = self._seeing_but_lost = 0
        located = self._look_for_stored_map(located)
        covariance = self._covariance(located, before)
        located = self._held_by(fix, located, covariance, timestamp)
        self.landmarks.count_sightings(located.visible_row, located.landmark_id, located.frame.features, timestamp)
        visible_id = self.landmarks.id[located.visible_row]
        if self._keyframe_policy.wants(located, self._mapper.keyframes[-1:]):
            located = self._made_keyframe(located, timestamp)
        self._last = located
        state, why = judged(located.n_stored_inliers, self.settings.min_stored_inliers, self._has_map)
        told = (located.n_inliers, located.n_stored_inliers, located.landmark_id, visible_id)
        return TrackedFrame(index, timestamp, state, reason or why, located.T_map_cam.copy(), covariance, *told)

    def _made_keyframe(self, located: Located, timestamp: float) -> Located:
        """The frame with the landmarks that were made from it."""
        T, drift = located.T_map_cam.copy(), self._uncertainty.drift
        sigma_m = float(np.sqrt(np.diag(drift)[:3].max()))
        keyframe = Keyframe(self._count, T, located.frame, located.landmark_id, self._since_keyframe.drift, sigma_m)
        self._since_keyframe.anchor()
        self._mapper.insert(keyframe, timestamp)
        self._keyframe_policy.took(keyframe.landmark_id)
        retired = self._mapper.take_retired()
        if not self._has_map:
            self.loops.remember(retired, self.landmarks)
        return replace(located, landmark_id=keyframe.landmark_id)

    def _covariance(self, located: Located, before: Located | None) -> NDArray[np.float64]:
        """The stored map holds the pose; without it the pose drifts on from that of the frame before."""
        own = located.estimate.covariance
        if self._has_map and located.n_stored_inliers >= self.settings.min_stored_inliers:
            return self._uncertainty.anchor(own)
        T_before = located.T_map_cam if before is None else before.T_map_cam
        self._since_keyframe.move(T_before, located.T_map_cam, own)
        return self._uncertainty.move(T_before, located.T_map_cam, own)

    def _held_by(
        self, fix: GnssPosition | None, located: Located, covariance: NDArray[np.float64], timestamp: float
    ) -> Located:
        """Satellite fixes hold odometry, which drifts; what the stored map holds needs them not."""
        is_held = self._has_map and located.n_stored_inliers >= self.settings.min_stored_inliers
        if fix is None or is_held or self._mapper.is_adjusting:
            return located
        found = self._gnss.correction(located.T_map_cam, covariance, fix, timestamp)
        if found is None:
            return located
        self._mapper.move(found.motion)
        self.loops.carry(found.motion)
        self._uncertainty.correct(found.remaining)
        return located.moved(found.motion)

    def _look_for_stored_map(self, located: Located) -> Located:
        """While odometry bridges a gap of the stored map: find the map again and mend the drift."""
        if not self._has_map:
            return located
        again = self._relocalizer.found_again(located, float(np.sqrt(np.max(np.diag(self._uncertainty.drift)[:3]))))
        if again is None:
            return located
        self._mapper.move(again.T_map_cam @ inverse(located.T_map_cam))
        return again

    def _lost(self, frame: ObservedFrame, timestamp: float, index: int, reason: str) -> TrackedFrame:
        """The pose carries on with the last motion for a while, and says that it is not to be trusted."""
        assert self._last is not None
        self._blind_frames += 1
        if self._velocity is not None and self._blind_frames <= _MAX_BLIND_FRAMES:
            self._last = self._last.moved(self._last.T_map_cam @ self._velocity @ inverse(self._last.T_map_cam))
        covariance = self._uncertainty.drift + np.diag([self._blind_m() ** 2] * 3 + [0.1] * 3)
        return TrackedFrame.without_pose(
            frame, timestamp, index, TrackingState.LOST, reason, self._last.T_map_cam, covariance
        )

    def _blind_m(self) -> float:
        """How far the car may have come since it was lost."""
        step_m = 0.0 if self._velocity is None else float(np.linalg.norm(self._velocity[:3, 3]))
        return self._blind_frames * max(step_m, _BLIND_STEP_M)

    def _nowhere(self, frame: ObservedFrame, timestamp: float, index: int, reason: str) -> TrackedFrame:
        T = np.eye(4) if self._T_start is None else self._T_start
        return TrackedFrame.without_pose(frame, timestamp, index, TrackingState.INITIALIZING, reason, T, _UNKNOWN)
