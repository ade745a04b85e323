"""Places and their landmarks adjusted together: the latest as the drive goes on, all once a loop has been closed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from autowaze.vehicle.slam.bundle_adjustment import COARSE, FINE, BundleProblem, adjust
from autowaze.vehicle.slam.loops.place import Place
from autowaze.vehicle.slam.loops.verification import Loop
from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import transform

_ITERATIONS = 8


def adjust_places(
    places: Sequence[Place],
    T_map_cam: NDArray[np.float64],
    loops: Sequence[Loop],
    camera: StereoCamera,
    settings: SlamSettings,
    n_held: int = 1,
    max_iterations: int = _ITERATIONS,
    is_final: bool = True,
) -> NDArray[np.float64]:
    """Poses (N, 4, 4) of least reprojection error over all places that still have features.

    Landmarks that loops found to be one are one. The first of those places, and those without features, are held.

    Args:
        places: of the drive, or the latest of them. T_map_cam: (N, 4, 4), where to start.
        loops: with their pairs of landmarks.
        camera, settings: as the features were observed with.
        n_held: so many of the first places with features stay where they are.
        max_iterations: see `adjust`.
        is_final: whether it should be adjusted to the last digits; what the next places will adjust again need not be.
    """
    seen = [k for k, place in enumerate(places) if len(place.features)]
    if len(seen) <= n_held + 1:
        return T_map_cam
    frames = [_observed(places[k], camera, settings) for k in seen]
    pose = np.repeat(np.arange(len(seen)), [len(f) for f in frames])
    landmark = _fused(np.concatenate([places[k].landmark_id for k in seen]), loops)
    position = np.concatenate([transform(T_map_cam[k], places[k].position_cam) for k in seen])
    chosen = _seen_twice(pose, landmark)
    point_id, point = np.unique(landmark[chosen], return_inverse=True)
    count = np.bincount(point)
    start = np.column_stack([np.bincount(point, weights=position[chosen, i]) / count for i in range(3)])
    problem = BundleProblem(
        T_map_cam=T_map_cam[seen],
        pose_free=np.arange(len(seen)) >= n_held,
        position=start,
        point_free=np.ones(len(point_id), np.bool_),
        keyframe=pose[chosen],
        point=point,
        measured=np.concatenate([f.measured for f in frames])[chosen],
        information=np.concatenate([f.information for f in frames])[chosen],
        weight=np.ones(len(chosen)),
    )
    out = T_map_cam.copy()
    out[seen] = adjust(problem, camera, max_iterations, FINE if is_final else COARSE).T_map_cam
    return out


def _observed(place: Place, camera: StereoCamera, settings: SlamSettings) -> ObservedFrame:
    sigma_px = (settings.corner_sigma_px, settings.disparity_sigma_px)
    return ObservedFrame(place.features, camera, settings.level_scale, sigma_px, settings.close_baselines)


def _fused(landmark_id: NDArray[np.int64], loops: Sequence[Loop]) -> NDArray[np.int64]:
    """One number per landmark (N,), the same for those that loops found to be one."""
    same = np.concatenate([np.zeros((0, 2), np.int64), *[loop.same for loop in loops]])
    ids, node = np.unique(np.concatenate([landmark_id, same.ravel()]), return_inverse=True)
    a, b = node[len(landmark_id) :].reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(a), np.int8), (a, b)), shape=(len(ids), len(ids)))
    return np.asarray(connected_components(graph, directed=False)[1][node[: len(landmark_id)]], dtype=np.int64)


def _seen_twice(pose: NDArray[np.int64], landmark: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows of the observations of landmarks that more than one place sees, each by a place once."""
    n_places = int(pose.max()) + 1
    _, first = np.unique(landmark * n_places + pose, return_index=True)
    _, group = np.unique(landmark[first], return_inverse=True)
    return np.asarray(np.sort(first[np.bincount(group)[group] > 1]))
