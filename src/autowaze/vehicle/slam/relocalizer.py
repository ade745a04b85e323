"""Finding the pose without a prediction: by appearance, then geometry, then the whole local map."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.consensus import pose_by_consensus
from autowaze.vehicle.slam.gnss_constraint import GnssPosition
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.tracker import Located, Tracker
from autowaze.vehicle.vision.compiled import compiled, hamming
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import Pose

START_SIGMA_M = 5.0  # of a given start pose, as a satellite receiver has it
_SMALL_MAP_FEATURES = 60_000  # so many can all be compared with a frame's features in half a second
_RETRY_FRAMES = 5  # between attempts to find the stored map again while odometry holds
_MAX_HAMMING = 60
_RATIO = 0.85
_ELSEWHERE_M = 1.0  # the second best match must be another place, not a second landmark of the same corner
_MIN_INLIERS = 12
_WIDE = 3.0  # windows after the consensus, whose pose is good to a few pixels only
_PLACE_M, _LOOKING_RAD, _DISPARITY_PX = 1.0, 0.07, 0.5  # by which matches that agree on a place may be off
_MOST_VOTES, _PLACES = 1000, 20  # matches that say where the camera is, and places that are tried
_CHECKS = 5  # frames, from the one in which the map was found on, in which it is looked for once more
_OTHER_POSE_M = 0.2  # what is less far from a pose is left to tracking


PositionPrior = tuple[NDArray[np.float64], float]
"""Map position (3,) and its standard deviation, metres."""


def prior_of_fix(fix: GnssPosition | None) -> PositionPrior | None:
    """What a satellite fix says of the position; reflections make it worse than it knows."""
    return None if fix is None else (fix.position, max(fix.sigma_m, START_SIGMA_M))


class Relocalizer:
    """Places a frame in a set of landmarks."""

    def __init__(self, camera: StereoCamera, settings: SlamSettings, landmarks: Landmarks, tracker: Tracker) -> None:
        self.camera = camera
        self.settings = settings
        self.landmarks = landmarks
        self.tracker = tracker
        self._unlocalized_frames = 0
        self._checks_left = _CHECKS

    def locate(
        self, frame: ObservedFrame, rows: NDArray[np.int64], R_map_cam: NDArray[np.float64] | None = None
    ) -> Located | None:
        """Pose of a frame among the landmarks of these rows, or None when it is not found for certain.

        Args:
            R_map_cam: (3, 3), roughly which way the camera looks; None if nobody knows.
        """
        if len(rows) < _MIN_INLIERS or len(frame) < _MIN_INLIERS:
            return None
        found = self._by_appearance(frame, rows)
        feature = np.flatnonzero(found >= 0)
        position = self.landmarks.position[rows[found[feature]]]
        agreed = None
        if R_map_cam is not None:
            here = self._agree_on_place(frame, feature, position, R_map_cam)
            agreed = pose_by_consensus(position[here], frame.uv[feature[here]], self.camera, _MIN_INLIERS)
        agreed = agreed or pose_by_consensus(position, frame.uv[feature], self.camera, _MIN_INLIERS)
        if agreed is None:
            return None
        near = self._around(rows, agreed[0])
        located = self.tracker.in_map(frame, agreed[0], near, widen=_WIDE)
        located = self.tracker.in_map(frame, located.T_map_cam, near)
        return located if located.n_steering >= self.settings.min_relocalized_inliers else None

    def found_again(self, located: Located, drift_m: float) -> Located | None:
        """The same frame found in the stored map, or None: every few frames in a gap of it, and when it was just found.

        Of few far features a wrong pose may explain enough to pass, and features are then matched where it foretells
        them: such a pose holds itself. Other frames show other features, so the first ones are placed anew, and the
        place that more of the map agrees with counts.

        Args:
            located: the frame by odometry. drift_m: standard deviation of its position.
        """
        if located.n_stored_inliers >= self.settings.min_stored_inliers:
            self._unlocalized_frames = 0
            return self._checked(located)
        self._unlocalized_frames += 1
        if self._unlocalized_frames % _RETRY_FRAMES:
            return None
        rows = self.stored_rows((located.T_map_cam[:3, 3], 1.0 + drift_m))
        again = self.locate(located.frame, rows, located.T_map_cam[:3, :3])
        if again is None or again.n_stored_inliers < self.settings.min_stored_inliers:
            return None
        self._unlocalized_frames, self._checks_left = 0, _CHECKS
        return again

    def _checked(self, located: Located) -> Located | None:
        if self._checks_left == 0:
            return None
        self._checks_left -= 1
        rows = self.stored_rows((located.T_map_cam[:3, 3], START_SIGMA_M))
        again = self.locate(located.frame, rows, located.T_map_cam[:3, :3])
        if again is None or again.n_stored_inliers <= located.n_stored_inliers:
            return None
        moved_m = float(np.linalg.norm(again.T_map_cam[:3, 3] - located.T_map_cam[:3, 3]))
        return again if moved_m > _OTHER_POSE_M else None

    def stored_rows(self, prior: PositionPrior | None) -> NDArray[np.int64]:
        """Rows of the stored map to search: near the prior, or all of a small map."""
        if prior is not None:
            rows = self.rows_near(prior)
            return rows[self.landmarks.is_stored[rows]]
        stored = np.flatnonzero(self.landmarks.is_stored)
        return stored if len(stored) <= _SMALL_MAP_FEATURES else np.zeros(0, np.int64)

    def rows_near(self, prior: PositionPrior) -> NDArray[np.int64]:
        """Rows of all landmarks that may be seen from there."""
        position, sigma_m = prior
        offset = self.landmarks.position[:, :2] - position[:2]
        radius = self.settings.local_radius_m + 3.0 * sigma_m
        return np.flatnonzero(np.einsum("ij,ij->i", offset, offset) < radius**2)

    def _by_appearance(self, frame: ObservedFrame, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        words = np.ascontiguousarray(self.landmarks.descriptor[rows]).view(np.uint64)
        position = np.ascontiguousarray(self.landmarks.position[rows])
        return np.asarray(_match_anywhere(frame.words, frame.moving, words, position, _MAX_HAMMING, _RATIO))

    def _agree_on_place(
        self,
        frame: ObservedFrame,
        feature: NDArray[np.int64],
        position: NDArray[np.float64],
        R_map_cam: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """Numbers of the matches of features with positions (M, 3) that are seen where they should be from one place.

        Where it is known which way the camera looks, each match with a depth says by itself where it is, and that says
        in which direction the others should be. Where few matches are right, as in a car park on another day, samples
        of four, as consensus has to draw without this, are hardly ever right altogether.
        """
        f = frame.features
        deep = np.flatnonzero(f.has_depth[feature])
        deep = deep[:: len(deep) // _MOST_VOTES + 1]
        depth = f.depth[feature[deep]].astype(np.float64)
        places = position[deep] - f.position_cam[feature[deep]].astype(np.float64) @ R_map_cam.T
        doubt = _PLACE_M + depth * (_LOOKING_RAD + _DISPARITY_PX * depth / self.camera.bf)
        larger = np.maximum(doubt[:, None], doubt[None])
        agree = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2) < larger
        density = np.where(agree, larger**-2, 0.0).sum(axis=1)
        most = np.zeros(0, np.int64)
        for i in np.argsort(-density, kind="stable")[:_PLACES]:
            place = np.average(places[agree[i]], axis=0, weights=doubt[agree[i]] ** -2)
            seen = (position - place) @ R_map_cam
            distance = np.maximum(seen[:, 2], 1.0)
            off = np.abs(f.uv[feature] - self.camera.project(np.column_stack([seen[:, :2], distance]))[:, :2])
            allowed = self.camera.fx * (_LOOKING_RAD + 2.0 * _PLACE_M / distance)[:, None]
            fits = np.flatnonzero((seen[:, 2] > 0.0) & (off < allowed).all(axis=1))
            most = fits if len(fits) > len(most) else most
        return most

    def _around(self, rows: NDArray[np.int64], T_map_cam: Pose) -> NDArray[np.int64]:
        offset = self.landmarks.position[rows, :2] - T_map_cam[:2, 3]
        return np.asarray(rows[np.einsum("ij,ij->i", offset, offset) < self.settings.local_radius_m**2])


@compiled
def _match_anywhere(words, skip, candidate_words, position, max_hamming, ratio):  # type: ignore[no-untyped-def]
    """Row of the candidate most like each feature (N,), -1 where it is unlike all, or like two different places."""
    n, m = words.shape[0], candidate_words.shape[0]
    found = np.full(n, -1, np.int64)
    for i in range(n):
        if skip[i]:
            continue
        best: Any = -1
        best_distance, second = np.int64(257), np.int64(257)
        for j in range(m):
            distance = np.int64(hamming(words, i, candidate_words, j))
            if distance >= second:
                continue
            elsewhere = True
            if best >= 0:
                dx = position[j, 0] - position[best, 0]
                dy = position[j, 1] - position[best, 1]
                dz = position[j, 2] - position[best, 2]
                elsewhere = dx * dx + dy * dy + dz * dz > _ELSEWHERE_M**2
            if distance < best_distance:
                if elsewhere:
                    second = best_distance
                best, best_distance = j, distance
            elif elsewhere:
                second = distance
        if best >= 0 and best_distance <= max_hamming and best_distance < ratio * second:
            found[i] = best
    return found
