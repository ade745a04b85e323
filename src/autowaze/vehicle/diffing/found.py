"""Which landmarks a window found, how often, as what, and from how near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing.novelty import Candidates
from autowaze.vehicle.diffing.tally import Tally
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import transform

_STEREO_SIGMA_PX = 0.3  # of sub-pixel sparse stereo
_CORNER_SIGMA_PX = 1.0  # of corners of all levels, drift of the pose between the views included
_VIEWS = 10  # bundle adjustment sees a landmark from so many keyframes at once
_NEXT_LANE_M = 3.0
_NO_DEPTH_M = 1e3
_LABEL_BITS = 4


class FoundLandmarks:
    """Rows of (frame, landmark) over a window."""

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera
        self._found = Tally()
        self._wanted = Tally()
        self._depths: list[NDArray[np.float64]] = []
        self._places: list[NDArray[np.float64]] = []
        self._centres: list[NDArray[np.float64]] = []

    def add(self, tracked: TrackedFrame, features: CameraFeatures, map_is_thin: bool = True) -> None:
        """Landmarks that the frame matched, with the label, instance and place that their features have."""
        hit = tracked.landmark_id >= 0
        label_and_instance = (features.instance_id[hit].astype(np.int64) << _LABEL_BITS) | features.label[hit]
        self._found.add(tracked.landmark_id[hit], label_and_instance)
        if map_is_thin:
            self._wanted.add(tracked.landmark_id[hit])
        self._depths.append(np.nan_to_num(features.depth[hit].astype(np.float64), nan=_NO_DEPTH_M))
        self._places.append(transform(tracked.T_map_cam, features.position_cam[hit]))
        self._centres.append(np.broadcast_to(tracked.T_map_cam[:3, 3].copy(), (int(hit.sum()), 3)))

    def candidates(self, landmarks: Landmarks, sent: NDArray[np.int64]) -> Candidates:
        """Those that the stored map lacks and that were not sent before."""
        ids, found = self._found.counts()
        depth, place = self._nearest_observations()
        label_and_instance = self._found.majority()[1]
        wanted = _counts_of(ids, *self._wanted.counts())
        rows = landmarks.rows(ids)
        keep = (rows >= 0) & ~np.isin(ids, sent)
        keep[keep] = landmarks.map_id[rows[keep]] == 0
        position = landmarks.position[rows[keep]]
        depth_sigma = depth[keep] ** 2 * _STEREO_SIGMA_PX / self.camera.bf
        position_sigma = self._position_sigma(ids[keep], position, depth_sigma)
        return Candidates(
            landmark_id=ids[keep],
            position=position,
            label=(label_and_instance[keep] & ((1 << _LABEL_BITS) - 1)).astype(np.uint8),
            instance=label_and_instance[keep] >> _LABEL_BITS,
            found=found[keep],
            wanted=wanted[keep],
            depth_sigma_m=depth_sigma,
            position_sigma_m=position_sigma,
            offset_px=self.camera.fx * _NEXT_LANE_M * position_sigma / depth[keep] ** 2,
            deviation_m=np.linalg.norm(position - place[keep], axis=1),
        )

    def _nearest_observations(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Depth (N,) and place (N, 3) of each found landmark when it was nearest, sorted by landmark id."""
        ids, _ = self._found.pairs()
        if not len(ids):
            return np.zeros(0), np.zeros((0, 3))
        depth = np.concatenate(self._depths)
        order = np.lexsort((depth, ids))
        nearest = order[np.r_[True, np.diff(ids[order]) != 0]]
        return depth[nearest], np.concatenate(self._places)[nearest]

    def _position_sigma(
        self, landmark_id: NDArray[np.int64], position: NDArray[np.float64], depth_sigma_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Standard deviation (N,) of positions (N, 3) in the direction in which each is known worst, metres.

        What the stereo pair does not tell of the depth, directions from several places do: their information,
        (f / sigma d)^2 (I - u u') each, is summed over the nearest views, and that of the nearest depth added.
        """
        seen, centre = self._found.pairs()[0], np.concatenate([*self._centres, np.zeros((0, 3))])
        is_asked = np.isin(seen, landmark_id)
        row, centre = np.searchsorted(landmark_id, seen[is_asked]), centre[is_asked]
        ray = position[row] - centre
        distance = np.maximum(np.linalg.norm(ray, axis=1), 1e-3)
        order = np.lexsort((distance, row))
        row, ray, distance = row[order], ray[order] / distance[order, None], distance[order]
        rank = np.arange(len(row)) - np.searchsorted(row, row)
        across = np.where(rank < _VIEWS, (self.camera.fx / (_CORNER_SIGMA_PX * distance)) ** 2, 0.0)
        along = np.where(rank == 0, depth_sigma_m[row] ** -2.0, 0.0)
        weight = (along - across)[:, None, None] * ray[:, :, None] * ray[:, None, :] + across[:, None, None] * np.eye(3)
        information = np.zeros((len(landmark_id), 3, 3))
        for i, j in zip(*np.triu_indices(3), strict=True):
            information[:, i, j] = information[:, j, i] = np.bincount(row, weight[:, i, j], len(landmark_id))
        least = np.linalg.eigvalsh(information)[:, 0] if len(landmark_id) else np.zeros(0)
        return np.asarray(np.maximum(least, 1e-12) ** -0.5)


def _counts_of(ids: NDArray[np.int64], counted: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """The count (N,) of each id, 0 for those that were not counted; `counted` is sorted."""
    if len(counted) == 0:
        return np.zeros(len(ids), np.int64)
    row = np.searchsorted(counted, ids).clip(max=len(counted) - 1)
    return np.where(counted[row] == ids, counts[row], 0)
