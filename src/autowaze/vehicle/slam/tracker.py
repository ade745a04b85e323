"""Pose of a frame: first against the last frame, then against the local map (ORB-SLAM2, sec. III)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.consensus import pose_by_consensus
from autowaze.vehicle.slam.landmarks import NO_LANDMARK, Landmarks
from autowaze.vehicle.slam.matching import match_in_windows
from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.vehicle.slam.pose_optimization import PoseEstimate, optimize_pose
from autowaze.vehicle.slam.projection import Predictions, predict
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.small_matrices import then
from autowaze.world.camera import StereoCamera
from autowaze.world.labels import is_movable
from autowaze.world.pose import Pose, inverse

_MOTION_ROUNDS, _MOTION_FEATURES = 2, 200  # this pose only says where to look in the map
_MOTION_SOUGHT = 500  # of the last frame's features, where the motion is foretold
_MOTION_RADII_PX = (20.0, 60.0)  # around the predicted pixel at level 0; the wide one when the narrow one fails
_MAP_RADIUS_PX, _MAP_RADIUS_OBLIQUE_PX = 4.0, 6.0
_MIN_MOTION_INLIERS = 20
_MOTION_AGREES = 1 / 3
"""Share of the matches that agree on a motion which is found: 0.42 or more, mostly 0.6, where a drive goes on evenly;
0.03 to 0.3 where it began or ended a turn between two frames: what had left the windows, others matched by chance."""


@dataclass(frozen=True)
class Located:
    """A frame with its pose.

    Attributes:
        estimate: pose and covariance.
        landmark_id: (N,) int64 per feature, inliers only; -1 for none.
        visible_row: (M,) int64, rows of the landmarks predicted visible.
        n_inliers, n_steering, n_stored_inliers: how many features agree, how many of them held the pose, and how many
            match the stored map.
    """

    frame: ObservedFrame
    estimate: PoseEstimate
    landmark_id: NDArray[np.int64]
    visible_row: NDArray[np.int64]
    n_inliers: int
    n_steering: int
    n_stored_inliers: int

    @property
    def T_map_cam(self) -> Pose:  # noqa: N802
        """Pose (4, 4)."""
        return self.estimate.T_map_cam

    @classmethod
    def at(cls, frame: ObservedFrame, T_map_cam: Pose) -> Located:
        """A frame whose pose is given, with no landmarks yet."""
        estimate = PoseEstimate(T_map_cam, np.zeros((6, 6)), np.zeros(0, np.bool_), np.zeros(0))
        none = np.full(len(frame), NO_LANDMARK, np.int64)
        return cls(frame, estimate, none, np.zeros(0, np.int64), 0, 0, 0)

    def moved(self, motion: Pose) -> Located:
        """The same frame after the map moved under it (4, 4, map to map)."""
        return replace(self, estimate=replace(self.estimate, T_map_cam=then(motion, self.T_map_cam)))


class Tracker:
    """Finds the pose of a frame near a predicted one."""

    def __init__(self, camera: StereoCamera, settings: SlamSettings, landmarks: Landmarks) -> None:
        self.camera = camera
        self.settings = settings
        self.landmarks = landmarks
        self._level_scale = settings.level_scale

    def first_look(self, frame: ObservedFrame, last: Located, velocity: Pose | None) -> Pose | None:
        """Pose by the features of the last frame; as its velocity has it, if known, where too few are found again."""
        T_predicted = None if velocity is None else last.T_map_cam @ velocity
        T = self.from_last(frame, last, T_predicted)
        return T_predicted if T is None else T

    def from_last(self, frame: ObservedFrame, last: Located, T_predicted: Pose | None) -> Pose | None:
        """Pose by the features of the last frame, or None when too few of them are found again.

        Around the predicted place first, then farther away. Without a prediction, or where it is no good, the matches
        vote for the motion: what moves along with the car, or dirt on the lens, must not pass for rest. Where no try
        is convincing, the one that most matches agree on counts.
        """
        best, most = None, _MIN_MOTION_INLIERS - 1
        lasting = np.flatnonzero(~last.frame.moving & (last.frame.features.has_depth | (last.landmark_id >= 0)))
        some = lasting[:: max(len(lasting) // _MOTION_SOUGHT, 1)]
        tries = [(T_predicted, some, radius) for radius in _MOTION_RADII_PX if T_predicted is not None]
        for predicted, chosen, radius in [*tries, (None, lasting, _MOTION_RADII_PX[-1])]:
            T = last.T_map_cam if predicted is None else predicted
            position, ray_error = self._points_of(last, chosen)
            source, feature = self._match_last(frame, T, position, last.frame, chosen, radius)
            if predicted is None:
                agreed = pose_by_consensus(position[source], frame.uv[feature], self.camera, _MIN_MOTION_INLIERS)
                if agreed is None:
                    continue
                T, source, feature = agreed[0], source[agreed[1]], feature[agreed[1]]
            if len(feature) < _MIN_MOTION_INLIERS:
                continue
            every = max(len(source) // _MOTION_FEATURES, 1)
            source, feature = source[::every], feature[::every]
            label = last.frame.features.label[chosen[source]]
            weight = self._weights(frame, feature, label, np.zeros(len(feature), np.bool_))
            estimate = optimize_pose(
                T,
                position[source],
                frame.measured[feature],
                frame.information[feature],
                weight,
                self.camera,
                ray_error[source],
                rounds=_MOTION_ROUNDS,
            )
            n_agree = int(np.count_nonzero(estimate.inlier & (weight > 0)))
            if n_agree > most:
                best, most = estimate.T_map_cam, n_agree
            if n_agree >= max(_MIN_MOTION_INLIERS, _MOTION_AGREES * np.count_nonzero(weight)):
                break
        return best

    def in_map(
        self, frame: ObservedFrame, T_map_cam: Pose, local_rows: NDArray[np.int64], widen: float = 1.0
    ) -> Located:
        """Pose by the landmarks of the local map, started near it."""
        predictions = predict(self.landmarks, local_rows, T_map_cam, self.camera, self._level_scale)
        found = self._match_map(frame, predictions, widen)
        feature, row = found[found >= 0], predictions.row[found >= 0]
        weight = self._weights(frame, feature, self.landmarks.label[row], self.landmarks.is_stored[row])
        estimate = optimize_pose(
            T_map_cam,
            self.landmarks.position[row],
            frame.measured[feature],
            frame.information[feature],
            weight,
            self.camera,
            self._depth_error(row, T_map_cam),
        )
        landmark_id = np.full(len(frame), NO_LANDMARK, np.int64)
        landmark_id[feature[estimate.inlier]] = self.landmarks.id[row[estimate.inlier]]
        stored = self.landmarks.is_stored[row[estimate.inlier]]
        return Located(
            frame,
            estimate,
            landmark_id,
            predictions.row,
            int(np.count_nonzero(estimate.inlier)),
            int(np.count_nonzero(estimate.inlier & (weight > 0))),
            int(np.count_nonzero(stored)),
        )

    def _match_map(self, frame: ObservedFrame, predictions: Predictions, widen: float) -> NDArray[np.int64]:
        """Features of the predicted landmarks; those of the stored map choose first."""
        radius = np.where(predictions.frontal, _MAP_RADIUS_PX, _MAP_RADIUS_OBLIQUE_PX) * widen
        radius *= self._level_scale[predictions.level]
        words = self.landmarks.descriptor.view(np.uint64)
        stored = self.landmarks.is_stored[predictions.row]
        found = np.full(len(predictions), -1, np.int64)
        taken = frame.moving.copy()
        for group in _parts(stored):
            found[group] = match_in_windows(
                frame,
                words,
                predictions.row[group],
                predictions.pixel[group],
                predictions.level[group],
                radius[group],
                taken,
                self.settings.max_hamming,
                self.settings.ratio,
            )
            taken[found[group][found[group] >= 0]] = True
        return found

    def _match_last(
        self,
        frame: ObservedFrame,
        T_map_cam: Pose,
        position: NDArray[np.float64],
        source: ObservedFrame,
        source_row: NDArray[np.int64],
        radius_px: float,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """What was sought (rows of `source_row`) and the features of this frame that match."""
        pixel, ahead = _project(position, T_map_cam, self.camera)
        level = source.octave[source_row]
        found = match_in_windows(
            frame,
            source.words,
            source_row,
            np.where(ahead[:, None], pixel, -1e6),
            level,
            radius_px * self._level_scale[level],
            frame.moving,
            self.settings.max_hamming,
            self.settings.ratio,
        )
        hit = found >= 0
        return np.flatnonzero(hit), found[hit]

    def _points_of(self, last: Located, feature: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Map positions (M, 3) of some features of a frame, the landmark's, else by stereo; NaN where unknown.

        With them the standard deviations along the rays on which they were seen, as vectors (M, 3) in the map, m.
        """
        T = last.T_map_cam
        ray = last.frame.features.position_cam[feature].astype(np.float64) @ T[:3, :3].T
        position = ray + T[:3, 3]
        sigma_px = self.settings.disparity_sigma_px * self._level_scale[last.frame.octave[feature]]
        error = ray * (sigma_px * np.linalg.norm(ray, axis=1) / self.camera.bf)[:, None]
        rows = self.landmarks.rows(last.landmark_id[feature])
        known = rows >= 0
        position[known] = self.landmarks.position[rows[known]]
        error[known] = self._depth_error(rows[known], T)
        return position, error

    def _depth_error(self, row: NDArray[np.int64], T_map_cam: Pose) -> NDArray[np.float64]:
        """Standard deviation along the viewing ray (M, 3), m, from stereo noise and the number of observations."""
        store = self.landmarks
        distance = np.linalg.norm(store.position[row] - T_map_cam[:3, 3], axis=1)
        one_view = self.settings.disparity_sigma_px * store.max_distance[row] * distance / self.camera.bf
        error = one_view / np.sqrt(np.maximum(store.n_observations[row], 1))
        return np.asarray(store.normal[row] * error[:, None], np.float64)

    def _weights(
        self,
        frame: ObservedFrame,
        feature: NDArray[np.int64],
        landmark_label: NDArray[np.uint8],
        stored: NDArray[np.bool_],
    ) -> NDArray[np.float64]:
        """What stands for good counts; what may drive away does only where the rest is too little.

        Landmarks of this drive inherit the error of the pose from which they were made: they count less where the
        stored map holds the pose.
        """
        s = self.settings
        movable = is_movable(frame.features.label[feature]) | is_movable(landmark_label)
        enough = np.count_nonzero(~movable) >= s.min_static_inliers
        weight = np.where(movable, 0.0 if enough else s.movable_weight, 1.0)
        if np.count_nonzero(stored & ~movable) >= s.min_static_inliers:
            weight[~stored] *= s.own_weight
        return weight


def _parts(first: NDArray[np.bool_]) -> list[Any]:
    """What picks the rows of a mask, and then the others; where they are all of one kind nothing is copied."""
    n_first = np.count_nonzero(first)
    return [first, ~first] if 0 < n_first < len(first) else [slice(None)]


def _project(
    position: NDArray[np.float64], T_map_cam: Pose, camera: StereoCamera
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """u, v, disparity (N, 3) of map points, and which lie ahead of the camera."""
    T = inverse(T_map_cam)
    points = position @ T[:3, :3].T + T[:3, 3]
    ahead = points[:, 2] > 0.1
    pixel = camera.project(np.where(ahead[:, None], points, 1.0))
    pixel[:, 2] = pixel[:, 0] - pixel[:, 2]
    return pixel, ahead
