"""Which landmarks a window found, how often, as what, and from how near."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing.novelty import Candidates, found_often_enough
from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.vehicle.diffing.sightings import by_landmark, position_sigmas, summed_up
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import transform

_STEREO_SIGMA_PX = 0.3  # of sub-pixel sparse stereo
_CORNER_SIGMA_PX = 1.0  # of corners of all levels, drift of the pose between the views included
_NEXT_LANE_M = 3.0
_NO_DEPTH_M = 1e3
_LABEL_BITS = 4


_COLUMNS: dict[str, tuple[Any, tuple[int, ...]]] = {
    "id": (np.int64, ()),
    "kind": (np.int64, ()),
    "frame": (np.int64, ()),
    "depth": (np.float64, ()),
    "place": (np.float64, (3,)),
}
_CAPACITY = 1 << 14


class FoundLandmarks:
    """Sightings of a window, one row per frame and landmark; their memory is kept from one window to the next."""

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera
        self._rows = {name: np.empty((_CAPACITY, *shape), dtype) for name, (dtype, shape) in _COLUMNS.items()}
        self.clear()

    def clear(self) -> None:
        """Begin another window."""
        self._count = 0
        self._centres: list[NDArray[np.float64]] = []
        self._thin: list[bool] = []

    def add(self, tracked: TrackedFrame, features: CameraFeatures, map_is_thin: bool = True) -> None:
        """Landmarks that the frame matched, with the label, instance and place that their features have."""
        hit = np.flatnonzero(tracked.landmark_id >= 0)
        depth = features.depth[hit]
        self._append(
            id=tracked.landmark_id[hit],
            kind=(features.instance_id[hit].astype(np.int64) << _LABEL_BITS) | features.label[hit],
            frame=np.full(len(hit), len(self._thin)),
            depth=np.where(np.isnan(depth), _NO_DEPTH_M, depth),
            place=transform(tracked.T_map_cam, features.position_cam[hit]),
        )
        self._centres.append(tracked.T_map_cam[:3, 3].copy())
        self._thin.append(map_is_thin)

    def candidates(self, landmarks: Landmarks, sent: NDArray[np.int64], settings: DiffSettings) -> Candidates:
        """Those that the stored map lacks and that were not sent before."""
        is_asked = landmarks.map_id == 0
        told = landmarks.rows(sent)
        is_asked[told[told >= 0]] = False
        ids, kinds, frame, depth, place = (column[: self._count] for column in self._rows.values())
        rows, starts, order = by_landmark(landmarks.rows(ids), is_asked)
        kind, found, wanted, nearest = summed_up(starts, order, frame, kinds, depth, np.array(self._thin, np.bool_))
        label = (kind & ((1 << _LABEL_BITS) - 1)).astype(np.uint8)
        often = found_often_enough(label, found, wanted, settings)
        position, depth = landmarks.position[rows], depth[nearest]
        depth_sigma = depth**2 * _STEREO_SIGMA_PX / self.camera.bf
        centres = np.array(self._centres, np.float64).reshape(-1, 3)
        corner_px = self.camera.fx / _CORNER_SIGMA_PX
        position_sigma = position_sigmas(starts, order, frame, centres, position, depth_sigma, often, corner_px)
        return Candidates(
            landmark_id=landmarks.id[rows],
            position=position,
            label=label,
            instance=kind >> _LABEL_BITS,
            found=found,
            wanted=wanted,
            depth_sigma_m=depth_sigma,
            position_sigma_m=position_sigma,
            offset_px=self.camera.fx * _NEXT_LANE_M * position_sigma / depth**2,
            deviation_m=np.linalg.norm(position - place[nearest], axis=1),
        )

    def _append(self, **columns: NDArray[Any]) -> None:
        start, self._count = self._count, self._count + len(columns["id"])
        for name, column in columns.items():
            while self._count > len(self._rows[name]):
                self._rows[name] = np.concatenate([self._rows[name], np.empty_like(self._rows[name])])
            self._rows[name][start : self._count] = column
