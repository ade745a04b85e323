"""The map around the car: keyframes in, landmarks made and culled, bundle adjustment behind the scenes."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.bundle_adjustment import BundleProblem, BundleSolution, adjust
from autowaze.vehicle.slam.keyframe import Keyframe
from autowaze.vehicle.slam.landmarks import NO_LANDMARK, Landmarks
from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.small_matrices import then
from autowaze.world.camera import StereoCamera
from autowaze.world.labels import is_movable
from autowaze.world.pose import Pose, inverse, transform

_MIN_FOUND_SHARE = 0.25  # ORB-SLAM2: young landmarks found more rarely where predicted are culled
_MIN_PREDICTED = 8  # frames before that share means something
_CULL_EVERY = 4  # keyframes: moving rows costs as much for one landmark as for many
_FLEETING_S = 1.0  # a landmark that was never found again within it was none
_MIN_SHARED = 15  # ORB-SLAM2: landmarks that two keyframes share to be covisible


@dataclass
class _Pending:
    due: int
    last_id: int
    keyframes: list[Keyframe]
    seen_once: list[NDArray[np.int64]]
    point_id: NDArray[np.int64]
    observation_feature: NDArray[np.int64]
    problem: BundleProblem
    solution: Future[BundleSolution]
    carried: Pose = field(default_factory=lambda: np.eye(4))  # by what the map moved meanwhile

    def result(self) -> BundleSolution:
        """The adjustment, once it is ready, where the map is today."""
        solution = self.solution.result()
        T, position = then(self.carried, solution.T_map_cam), transform(self.carried, solution.position)
        return BundleSolution(T, position, solution.inlier)


class LocalMapper:
    """Keeps keyframes and landmarks, and adjusts the newest of them."""

    def __init__(self, camera: StereoCamera, settings: SlamSettings, landmarks: Landmarks) -> None:
        self.camera = camera
        self.settings = settings
        self.landmarks = landmarks
        self.keyframes: list[Keyframe] = []
        self._retired: list[Keyframe] = []
        self.n_keyframes = 0
        self.local_rows: NDArray[np.int64] = np.zeros(0, np.int64)
        self._level_scale = settings.level_scale
        self._pending: _Pending | None = None
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="bundle-adjustment")

    def insert(self, keyframe: Keyframe, timestamp: float) -> None:
        """Take in a keyframe; landmarks are made of what it sees for the first time, and noted in it."""
        frame, T_map_cam = keyframe.frame, keyframe.T_map_cam
        self._observe_again(frame, T_map_cam, keyframe.landmark_id)
        keyframe.landmark_id = self._create(frame, T_map_cam, keyframe.landmark_id, timestamp)
        self.keyframes.append(keyframe)
        self.n_keyframes += 1
        if self.n_keyframes % _CULL_EVERY == 0:
            self._forget(timestamp)
        self.refresh_local(T_map_cam)
        if self._pending is None and len(self.keyframes) > 1:
            self._start_adjustment(keyframe.index + self.settings.adjustment_frames)

    @property
    def is_adjusting(self) -> bool:
        """Whether a bundle adjustment is under way."""
        return self._pending is not None

    def adopt(self, index: int) -> Pose | None:
        """Apply the bundle adjustment that is due at this frame; returns how it moved the newest keyframe (4, 4)."""
        if self._pending is None or index < self._pending.due:
            return None
        pending, self._pending = self._pending, None
        solution = pending.result()
        newest = pending.keyframes[-1]
        moved: Pose = solution.T_map_cam[-1] @ inverse(newest.T_map_cam)
        for keyframe, T, once in zip(pending.keyframes, solution.T_map_cam, pending.seen_once, strict=True):
            self._carry(once, T @ inverse(keyframe.T_map_cam))
            keyframe.T_map_cam = T
        rows = self.landmarks.rows(pending.point_id)
        alive = (rows >= 0) & pending.problem.point_free
        self.landmarks.position[rows[alive]] = solution.position[alive]
        self._move_later(pending, moved)
        self._forget_outliers(pending, solution)
        return moved

    def finish(self) -> Pose | None:
        """Wait for the adjustment under way and apply it."""
        return self.adopt(self._pending.due) if self._pending else None

    def move(self, motion: Pose) -> None:
        """Move the latest keyframes and all landmarks of this drive (4, 4, map to map), as when drift is mended.

        What a bundle adjustment under way finds will move along.
        """
        if self._pending is not None:
            self._pending.carried = then(motion, self._pending.carried)
        for keyframe in self.keyframes:
            keyframe.T_map_cam = then(motion, keyframe.T_map_cam)
        own = np.flatnonzero(~self.landmarks.is_stored)
        self.landmarks.position[own] = self.landmarks.position[own] @ motion[:3, :3].T + motion[:3, 3]

    def take_retired(self) -> list[Keyframe]:
        """Keyframes that no adjustment will move any more, oldest first; each is given once."""
        retired, self._retired = self._retired, []
        return retired

    def forget(self) -> None:
        """Start anew: later keyframes share nothing with those before."""
        self.finish()
        self._retired += self.keyframes
        self.keyframes.clear()

    def refresh_local(self, T_map_cam: Pose) -> None:
        """Choose the landmarks to look for: those of the latest keyframes and those of the stored map nearby."""
        local = self._seen_by(self.keyframes[-self.settings.n_local_keyframes :]) > 0
        stored = np.flatnonzero(self.landmarks.is_stored)
        offset = self.landmarks.position[stored, :2] - T_map_cam[:2, 3]
        local[stored[np.einsum("ij,ij->i", offset, offset) < self.settings.local_radius_m**2]] = True
        self.local_rows = np.flatnonzero(local)

    def _carry(self, landmark_id: NDArray[np.int64], motion: Pose) -> None:
        """Move landmarks along with the keyframe that saw them."""
        rows = self.landmarks.rows(landmark_id)
        rows = rows[rows >= 0]
        self.landmarks.position[rows] = self.landmarks.position[rows] @ motion[:3, :3].T + motion[:3, 3]

    def _move_later(self, pending: _Pending, motion: Pose) -> None:
        """Keyframes and landmarks made since an adjustment began move as its newest keyframe does."""
        for keyframe in reversed(self.keyframes):
            if keyframe is pending.keyframes[-1]:
                break
            keyframe.T_map_cam = motion @ keyframe.T_map_cam
        later = self.landmarks.position[np.searchsorted(self.landmarks.id, pending.last_id, side="right") :]
        later[:] = later @ motion[:3, :3].T + motion[:3, 3]

    def _observe_again(self, frame: ObservedFrame, T_map_cam: Pose, landmark_id: NDArray[np.int64]) -> None:
        """Take over descriptor and viewing direction of the landmarks that a keyframe sees."""
        store = self.landmarks
        feature = np.flatnonzero(landmark_id >= 0)
        row = store.rows(landmark_id[feature])
        store.n_observations[row] += 1
        own = ~store.is_stored[row]
        feature, row = feature[own], row[own]
        store.descriptor[row] = frame.features.descriptor[feature]
        towards = T_map_cam[:3, 3] - store.position[row]
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        mean = store.normal[row] * (store.n_observations[row] - 1)[:, None] + towards
        store.normal[row] = mean / np.linalg.norm(mean, axis=1, keepdims=True)

    def _create(
        self, frame: ObservedFrame, T_map_cam: Pose, landmark_id: NDArray[np.int64], timestamp: float
    ) -> NDArray[np.int64]:
        features = frame.features
        near = features.depth < self.settings.max_depth_baselines * self.camera.baseline_m
        new = np.flatnonzero(near & (landmark_id < 0) & ~frame.moving)
        position = features.position_cam[new].astype(np.float64) @ T_map_cam[:3, :3].T + T_map_cam[:3, 3]
        towards = T_map_cam[:3, 3] - position
        distance = np.linalg.norm(towards, axis=1)
        max_distance = distance * self._level_scale[frame.octave[new]]
        landmark_id = landmark_id.copy()
        landmark_id[new] = self.landmarks.add(
            position=position,
            descriptor=features.descriptor[new],
            normal=towards / distance[:, None],
            min_distance=max_distance / self._level_scale[-1],
            max_distance=max_distance,
            label=features.label[new],
            instance=features.instance_id[new],
            n_visible=np.ones(len(new), np.int32),
            n_found=np.ones(len(new), np.int32),
            n_observations=np.ones(len(new), np.int32),
            first_seen=np.full(len(new), timestamp),
            last_seen=np.full(len(new), timestamp),
        )
        return landmark_id

    def _forget(self, timestamp: float) -> None:
        """Drop keyframes that no adjustment will use, and landmarks that are rarely found or long out of sight."""
        self._retired += self.keyframes[: -self.settings.n_local_keyframes]
        del self.keyframes[: -self.settings.n_local_keyframes]
        store = self.landmarks
        unseen_s = timestamp - store.last_seen
        gone = (store.n_visible >= _MIN_PREDICTED) & (store.n_found < _MIN_FOUND_SHARE * store.n_visible)
        gone |= (store.n_found == 1) & (unseen_s > _FLEETING_S)
        gone |= unseen_s > self.settings.memory_s
        store.remove(gone & ~store.is_stored)

    def _start_adjustment(self, due: int) -> None:
        free = self.keyframes[-self.settings.n_adjusted :]
        older = self.keyframes[: -self.settings.n_adjusted][-self.settings.n_fixed :]
        count = self._seen_by(free)
        seen = count > 0
        fixed = [k for k in older if np.count_nonzero(seen[self._rows_of(k)]) >= _MIN_SHARED]
        keyframes = fixed + free
        # What one keyframe alone sees, three measurements for three unknowns, tells nothing of the pose.
        tells = seen & ((count + self._seen_by(fixed) > 1) | self.landmarks.is_stored)
        alone = seen & ~tells
        seen_once = [self.landmarks.id[rows[alone[rows]]] for rows in map(self._rows_of, keyframes)]
        pose_free = np.arange(len(keyframes)) >= max(len(fixed), 1)
        problem, feature = self._problem(keyframes, pose_free, tells)
        solution = self._worker.submit(adjust, problem, self.camera)
        ids, last_id = self.landmarks.id[tells], int(self.landmarks.id[-1])
        self._pending = _Pending(due, last_id, keyframes, seen_once, ids, feature, problem, solution)

    def _rows_of(self, keyframe: Keyframe) -> NDArray[np.int64]:
        """Rows of the landmarks that it sees."""
        rows = self.landmarks.rows(keyframe.landmark_id)
        return rows[rows >= 0]

    def _seen_by(self, keyframes: list[Keyframe]) -> NDArray[np.int64]:
        """How many of the keyframes see each landmark (rows of the store,)."""
        rows = [self._rows_of(k) for k in keyframes] or [np.zeros(0, np.int64)]
        return np.bincount(np.concatenate(rows), minlength=len(self.landmarks))

    def _problem(
        self, keyframes: list[Keyframe], pose_free: NDArray[np.bool_], adjusted: NDArray[np.bool_]
    ) -> tuple[BundleProblem, NDArray[np.int64]]:
        """The adjustment of these keyframes and landmarks (mask of rows), and the feature of each observation."""
        point_of_row = np.where(adjusted, np.cumsum(adjusted) - 1, -1)
        point_of_row = np.append(point_of_row, -1)  # of row -1
        keyframe_row, point_row, feature = [], [], []
        for k, keyframe in enumerate(keyframes):
            point = point_of_row[self.landmarks.rows(keyframe.landmark_id)]
            seen = np.flatnonzero(point >= 0)
            keyframe_row.append(np.full(len(seen), k))
            point_row.append(point[seen])
            feature.append(seen)
        point = np.concatenate(point_row)
        rows = np.flatnonzero(adjusted)
        label_weight = np.where(is_movable(self.landmarks.label[rows]), self.settings.movable_weight, 1.0)
        problem = BundleProblem(
            T_map_cam=np.stack([k.T_map_cam for k in keyframes]),
            pose_free=pose_free,
            position=self.landmarks.position[rows],
            point_free=~self.landmarks.is_stored[rows],
            keyframe=np.concatenate(keyframe_row),
            point=point,
            measured=np.concatenate([k.frame.measured[f] for k, f in zip(keyframes, feature, strict=True)]),
            information=np.concatenate([k.frame.information[f] for k, f in zip(keyframes, feature, strict=True)]),
            weight=label_weight[point],
        )
        return problem, np.concatenate(feature)

    def _forget_outliers(self, pending: _Pending, solution: BundleSolution) -> None:
        """Drop the observations that disagree with the adjusted map."""
        wrong = ~solution.inlier
        for k, keyframe in enumerate(pending.keyframes):
            feature = pending.observation_feature[wrong & (pending.problem.keyframe == k)]
            rows = self.landmarks.rows(keyframe.landmark_id[feature])
            self.landmarks.n_observations[rows[rows >= 0]] -= 1
            keyframe.landmark_id[feature] = NO_LANDMARK
