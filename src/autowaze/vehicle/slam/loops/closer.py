"""Loop closing behind the scenes: places are searched, loops confirmed, the drive adjusted.

Everything heavy runs in a thread of its own; its results are applied at frame numbers fixed when it began, so that no
result depends on the speed of the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.keyframe import Keyframe
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.loops.adjustment import adjust_places
from autowaze.vehicle.slam.loops.looking_back import LookingBack, SeenBack
from autowaze.vehicle.slam.loops.place import Place, remembered
from autowaze.vehicle.slam.loops.pose_graph import GraphSolution, RelativePoses, optimize_graph
from autowaze.vehicle.slam.loops.verification import Loop
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.small_matrices import then, turned
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import Pose, inverse, make_pose, so3_exp, so3_log


@dataclass
class _Pending:
    due: int
    n_places: int
    result: Future[Any]
    apply: Callable[[Any], NDArray[np.float64] | None]
    carried: Pose = field(default_factory=lambda: np.eye(4))  # by what the map moved meanwhile


@dataclass(frozen=True)
class Correction:
    """How the map around the car moved.

    Attributes:
        motion: (4, 4), map to map.
        covariance: (6, 6) of the pose thereafter, in the map frame, where a loop was closed.
    """

    motion: Pose
    covariance: NDArray[np.float64] | None


class LoopCloser:
    """Remembers places, recognises them, and corrects the drive when it comes back to one.

    Attributes:
        places: of the drive so far, with their poses as they are known today.
        loops: the confirmed ones.
        corrections: (frame number, (4, 4) map to map): from this frame on poses are told after this motion.
        closings: numbers of the frames from which on loops were closed.
    """

    def __init__(self, camera: StereoCamera, settings: SlamSettings) -> None:
        self.camera = camera
        self.settings = settings
        self.places: list[Place] = []
        self.loops: list[Loop] = []
        self.corrections: list[tuple[int, Pose]] = []
        self.closings: list[int] = []
        self._looking_back = LookingBack(camera, settings)
        self._n_searched = self._n_forgotten = 0
        self._unconfirmed: list[Loop] = []
        self._n_closed = self._n_adjusted = 0  # loops that the poses agree with
        self._is_held_outside = False
        self._carried: Pose = np.eye(4)
        self._pending: _Pending | None = None
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="loop-closing")
        self._last_place: Pose = np.eye(4)  # where the map around the car has it
        self._since: NDArray[np.float64] = np.zeros((6, 6))  # covariance of the motion since then

    def remember(self, keyframes: Sequence[Keyframe], landmarks: Landmarks) -> None:
        """Take in keyframes that local bundle adjustment is done with, oldest first."""
        for keyframe in keyframes:
            self._since = self._since + keyframe.covariance
            if self._is_new_place(keyframe):
                self._add(keyframe, landmarks)

    def carry(self, motion: Pose) -> None:
        """The map around the car moved (4, 4, map to map): something absolute mended the drift.

        The latest places move along, those before stay where they were when it held them.
        """
        self._is_held_outside = True
        for place in self.places[-self.settings.loops.n_window :]:
            place.T_map_cam = then(motion, place.T_map_cam)
        self._last_place = then(motion, self._last_place)
        if self._pending is not None:
            self._pending.carried = then(motion, self._pending.carried)

    def adopt(self, index: int) -> Correction | None:
        """Apply what is due at this frame and begin what is next; returns how the map around the car moved."""
        moved = None
        if self._pending is not None and index >= self._pending.due:
            moved = self._apply()
            self.corrections += [] if moved is None else [(index, moved.motion)]
            self.closings += [] if moved is None or moved.covariance is None else [index]
        if self._pending is None:
            self._begin(index, self.settings.loops.leave_places)
        return moved

    def finish(self) -> None:
        """Look for loops to the end and close them, at once; it corrects the places alone."""
        while self._pending is not None or self._is_open():
            if self._pending is None:
                self._begin(0, 0)
            self._apply()

    def adjust(self) -> None:
        """Adjust the whole drive once more, at once, as for a map; every place that has been since then counts."""
        self.finish()
        self._carried = np.eye(4)
        if self.places:
            self._adjust(adjust_places(self.places, self._poses(), self.loops, self.camera, self.settings))

    def _is_open(self) -> bool:
        """Whether something is left to do."""
        n_known = min(self._n_closed, self._n_adjusted)
        return self._n_searched < len(self.places) or len(self.loops) > n_known

    def _is_new_place(self, keyframe: Keyframe) -> bool:
        if not self.places:
            return True
        step = inverse(self._last_place) @ keyframe.T_map_cam
        s = self.settings.loops
        far = np.linalg.norm(step[:3, 3]) > s.place_distance_m
        return bool(far or np.linalg.norm(so3_log(step[:3, :3])) > s.place_angle_rad)

    def _add(self, keyframe: Keyframe, landmarks: Landmarks) -> None:
        s = self.settings.loops
        T_before, covariance, path_m = np.eye(4), np.zeros((6, 6)), 0.0
        if self.places:
            before = self._last_place
            T_before = inverse(before) @ keyframe.T_map_cam
            path_m = self.places[-1].path_m + float(np.linalg.norm(T_before[:3, 3]))
            covariance = turned(before[:3, :3].T, self._since)
        self._since = np.zeros((6, 6))
        seen = remembered(keyframe, landmarks, s.features_per_place)
        self._last_place = T = keyframe.T_map_cam.copy()
        self.places.append(Place(keyframe.index, T, path_m, T_before, covariance, keyframe.sigma_m, *seen))

    def _begin(self, index: int, leave_places: int) -> None:
        """Start what is to be done next, if anything is."""
        s = self.settings.loops
        self._forget_oldest()
        if len(self.loops) > self._n_closed:
            self._submit(index + s.closing_frames, self._close, optimize_graph, self._poses(), self._known())
        elif self._n_searched < len(self.places):
            places, first = list(self.places), self._n_searched
            self._submit(index + s.search_frames, self._settle, self._looking_back, places, first)
        elif len(self.loops) > self._n_adjusted and len(self.places) > self.loops[-1].later + leave_places:
            due = index + s.adjustment_frames + len(self.places) // s.places_per_frame
            places, loops, T = list(self.places), list(self.loops), self._poses()
            self._submit(due, self._adjust, adjust_places, places, T, loops, self.camera, self.settings)

    def _submit(
        self, due: int, apply: Callable[[Any], NDArray[np.float64] | None], work: Callable[..., Any], *arguments: Any
    ) -> None:
        self._pending = _Pending(due, len(self.places), self._worker.submit(work, *arguments), apply)

    def _apply(self) -> Correction | None:
        """Take over the result under way; returns what became of the newest place that it knows, if it moved any."""
        assert self._pending is not None
        pending, self._pending = self._pending, None
        newest = self.places[pending.n_places - 1]
        before = newest.T_map_cam
        self._carried = pending.carried
        covariance = pending.apply(pending.result.result())
        if newest.T_map_cam is before:
            return None
        motion = then(newest.T_map_cam, inverse(before))
        for place in self.places[pending.n_places :]:
            place.T_map_cam = then(motion, place.T_map_cam)
        self._last_place = then(motion, self._last_place)
        return Correction(motion, covariance)

    def _settle(self, seen: SeenBack) -> None:
        """Take over the latest places, and what loops they found."""
        start, window, found = seen
        self._n_searched = self._looking_back.n_places
        self._place(start, window)
        self._confirm(found)

    def _confirm(self, found: list[Loop]) -> None:
        """Loops count once several places in a row found themselves in the same way."""
        s = self.settings.loops
        for loop in found:
            self._unconfirmed = [u for u in self._unconfirmed if loop.later - u.later <= 2 * s.n_consistent]
            agree = [
                u for u in self._unconfirmed if loop.agrees_with(u, self.places, s.consistency_m, s.consistency_rad)
            ]
            self._unconfirmed.append(loop)
            if len(agree) + 1 >= s.n_consistent:
                self.loops += [u for u in [*agree, loop] if u not in self.loops]

    def _close(self, solution: GraphSolution) -> NDArray[np.float64]:
        self._n_closed = len(self.loops)
        T = solution.T_map_cam
        if self._is_held_outside:
            T = _levelled_onto(T, self._poses()[: len(T)]) @ T
        for place, T_new in zip(self.places[: len(T)], then(self._carried, T), strict=True):
            place.T_map_cam = T_new
        return solution.covariance

    def _adjust(self, T_map_cam: NDArray[np.float64]) -> None:
        self._n_adjusted = len(self.loops)
        self._place(0, T_map_cam)
        self.loops = [replace(loop, T_earlier_later=self._between(loop.earlier, loop.later)) for loop in self.loops]

    def _place(self, start: int, T_map_cam: NDArray[np.float64]) -> None:
        """Take over adjusted poses; they are what is known of pairs of places from here on."""
        places = self.places[start : start + len(T_map_cam)]
        for place, T in zip(places, then(self._carried, T_map_cam), strict=True):
            place.T_map_cam = T
        for before, place in pairwise(places):
            place.T_before = inverse(before.T_map_cam) @ place.T_map_cam

    def _between(self, earlier: int, later: int) -> Pose:
        return np.asarray(inverse(self.places[earlier].T_map_cam) @ self.places[later].T_map_cam)

    def _poses(self) -> NDArray[np.float64]:
        return np.stack([place.T_map_cam for place in self.places])

    def _known(self) -> RelativePoses:
        """Odometry from place to place, and loops."""
        n, loops = len(self.places), self.loops
        return RelativePoses(
            a=np.concatenate([np.arange(n - 1), [loop.earlier for loop in loops]]),
            b=np.concatenate([np.arange(1, n), [loop.later for loop in loops]]),
            T_a_b=np.stack([p.T_before for p in self.places[1:]] + [loop.T_earlier_later for loop in loops]),
            covariance=np.stack([p.covariance for p in self.places[1:]] + [loop.covariance for loop in loops]),
            robust=np.arange(n - 1 + len(loops)) >= n - 1,
        )

    def _forget_oldest(self) -> None:
        """Places beyond what memory is meant for keep their poses alone."""
        while self._n_forgotten < min(len(self.places) - self.settings.loops.max_places, self._n_searched):
            self.places[self._n_forgotten].forget()
            self._looking_back.forget(self._n_forgotten)
            self._n_forgotten += 1


def _levelled_onto(T_map_cam: NDArray[np.float64], T_held: NDArray[np.float64]) -> Pose:
    """Motion (4, 4) about the vertical that takes poses (N, 4, 4) nearest to others (Umeyama 1991)."""
    a, b = T_map_cam[:, :3, 3], T_held[:, :3, 3]
    u, v = a[:, :2] - a[:, :2].mean(axis=0), b[:, :2] - b[:, :2].mean(axis=0)
    turn = np.arctan2(np.sum(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]), np.sum(u * v))
    R = so3_exp(np.array([0.0, 0.0, turn]))
    return make_pose(R, b.mean(axis=0) - R @ a.mean(axis=0))
