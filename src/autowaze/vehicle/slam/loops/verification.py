"""Whether two places are one, and how they lie to each other: by geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.loops.place import Place
from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.vehicle.slam.relocalizer import Relocalizer
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.tracker import Tracker
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import Pose, inverse, so3_log, transform

# What pose optimisation cannot know: landmarks of one place share the error of their stereo pair.
_FLOOR = np.diag([0.02**2] * 3 + [0.001**2] * 3)
_INFLATION = 2.5  # as that of poses from frame to frame


@dataclass(frozen=True, eq=False)
class Loop:
    """A place seen again.

    Attributes:
        earlier, later: numbers of the places.
        T_earlier_later: (4, 4) pose of the later camera in the earlier one.
        covariance: (6, 6) of its position (m) and rotation vector (rad) in the earlier camera.
        same: (M, 2) int64, landmark ids that are one, from before and from now.
        n_inliers: features that agree.
    """

    earlier: int
    later: int
    T_earlier_later: Pose
    covariance: NDArray[np.float64]
    same: NDArray[np.int64]
    n_inliers: int

    def agrees_with(self, other: Loop, places: Sequence[Place], distance_m: float, angle_rad: float) -> bool:
        """Whether another loop and the odometry on both sides lead to the same pose."""
        there = inverse(places[self.earlier].T_map_cam) @ places[other.earlier].T_map_cam
        back = inverse(places[other.later].T_map_cam) @ places[self.later].T_map_cam
        difference = inverse(self.T_earlier_later) @ there @ other.T_earlier_later @ back
        return bool(
            np.linalg.norm(difference[:3, 3]) < distance_m and np.linalg.norm(so3_log(difference[:3, :3])) < angle_rad
        )


def verify(
    places: Sequence[Place],
    earlier: int,
    later: int,
    n_around: int,
    min_inliers: int,
    camera: StereoCamera,
    settings: SlamSettings,
) -> Loop | None:
    """The later place found among the landmarks around the earlier one, or None when they are not surely the same.

    Matched by appearance, posed by RANSAC (P3P), then matched again in small windows and optimised over reprojection
    errors of both cameras, as a lost car finds itself in a map.
    """
    around = range(max(earlier - n_around, 0), min(earlier + n_around + 1, later))
    landmarks, landmark_id = _landmarks_around(places, earlier, around, settings)
    place = places[later]
    sigma_px = (settings.corner_sigma_px, settings.disparity_sigma_px)
    frame = ObservedFrame(place.features, camera, settings.level_scale, sigma_px, settings.close_baselines)
    tracker = Tracker(camera, settings, landmarks)
    located = Relocalizer(camera, settings, landmarks, tracker).locate(frame, np.arange(len(landmarks)))
    if located is None or located.n_inliers < min_inliers:
        return None
    found = np.flatnonzero(located.landmark_id >= 0)
    before = landmark_id[landmarks.rows(located.landmark_id[found])]
    return Loop(
        earlier,
        later,
        located.T_map_cam,
        _INFLATION * located.estimate.covariance + _FLOOR,
        np.column_stack([before, place.landmark_id[found]]),
        located.n_inliers,
    )


def _landmarks_around(
    places: Sequence[Place], centre: int, around: range, settings: SlamSettings
) -> tuple[Landmarks, NDArray[np.int64]]:
    """Landmarks of some places in the camera of one of them, and their ids; each once, as it was seen last."""
    T_centre = inverse(places[centre].T_map_cam)
    parts = []
    for k in around:
        place = places[k]
        T = T_centre @ place.T_map_cam
        position = transform(T, place.position_cam)
        towards = T[:3, 3] - position
        distance = np.linalg.norm(towards, axis=1)
        parts.append((place, position, towards / distance[:, None], distance))
    landmark_id = np.concatenate([place.landmark_id for place, *_ in parts])
    _, last = np.unique(landmark_id[::-1], return_index=True)
    rows = len(landmark_id) - 1 - last
    octave = np.concatenate([place.features.octave for place, *_ in parts])[rows]
    max_distance = np.concatenate([distance for *_, distance in parts])[rows] * settings.level_scale[octave]
    landmarks = Landmarks(capacity=len(rows) + 1)
    landmarks.add(
        position=np.concatenate([position for _, position, *_ in parts])[rows],
        descriptor=np.concatenate([place.features.descriptor for place, *_ in parts])[rows],
        normal=np.concatenate([normal for _, _, normal, _ in parts])[rows],
        min_distance=max_distance / settings.level_scale[-1],
        max_distance=max_distance,
        n_observations=np.bincount(np.unique(landmark_id, return_inverse=True)[1]),
    )
    return landmarks, landmark_id[rows]
