"""Which landmarks a window found, how often, as what, and from how near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing.novelty import Candidates
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


class FoundLandmarks:
    """Rows of (frame, landmark) over a window."""

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera
        self._ids: list[NDArray[np.int64]] = []
        self._kinds: list[NDArray[np.int64]] = []
        self._depths: list[NDArray[np.float32]] = []
        self._places: list[NDArray[np.float64]] = []
        self._centres: list[NDArray[np.float64]] = []
        self._thin: list[bool] = []

    def add(self, tracked: TrackedFrame, features: CameraFeatures, map_is_thin: bool = True) -> None:
        """Landmarks that the frame matched, with the label, instance and place that their features have."""
        hit = np.flatnonzero(tracked.landmark_id >= 0)
        self._ids.append(tracked.landmark_id[hit])
        self._kinds.append((features.instance_id[hit].astype(np.int64) << _LABEL_BITS) | features.label[hit])
        self._depths.append(features.depth[hit])
        self._places.append(transform(tracked.T_map_cam, features.position_cam[hit]))
        self._centres.append(tracked.T_map_cam[:3, 3].copy())
        self._thin.append(map_is_thin)

    def candidates(self, landmarks: Landmarks, sent: NDArray[np.int64]) -> Candidates:
        """Those that the stored map lacks and that were not sent before."""
        is_asked = landmarks.map_id == 0
        told = landmarks.rows(sent)
        is_asked[told[told >= 0]] = False
        ids = np.concatenate([*self._ids, np.zeros(0, np.int64)])
        depth = np.concatenate([*self._depths, np.zeros(0, np.float32)]).astype(np.float64)
        place = np.concatenate([*self._places, np.zeros((0, 3))])
        frame = np.repeat(np.arange(len(self._ids)), [len(own) for own in self._ids])
        rows, starts, order = by_landmark(landmarks.rows(ids), is_asked)
        kinds = np.concatenate([*self._kinds, np.zeros(0, np.int64)])
        depth[np.isnan(depth)] = _NO_DEPTH_M
        thin = np.array(self._thin, np.bool_)
        kind, found, wanted, nearest = summed_up(starts, order, frame, kinds, depth, thin)
        position, depth = landmarks.position[rows], depth[nearest]
        depth_sigma = depth**2 * _STEREO_SIGMA_PX / self.camera.bf
        centres = np.array(self._centres, np.float64).reshape(-1, 3)
        corner_px = self.camera.fx / _CORNER_SIGMA_PX
        position_sigma = position_sigmas(starts, order, frame, centres, position, depth_sigma, corner_px)
        return Candidates(
            landmark_id=landmarks.id[rows],
            position=position,
            label=(kind & ((1 << _LABEL_BITS) - 1)).astype(np.uint8),
            instance=kind >> _LABEL_BITS,
            found=found,
            wanted=wanted,
            depth_sigma_m=depth_sigma,
            position_sigma_m=position_sigma,
            offset_px=self.camera.fx * _NEXT_LANE_M * position_sigma / depth**2,
            deviation_m=np.linalg.norm(position - place[nearest], axis=1),
        )
