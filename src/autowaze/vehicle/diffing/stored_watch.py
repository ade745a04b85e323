"""What the frames of a window say about the stored features that they should have seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing.novelty import any_within
from autowaze.vehicle.diffing.removal import LookedFor
from autowaze.vehicle.diffing.tally import Tally
from autowaze.vehicle.diffing.visibility import Sight, sight_of
from autowaze.vehicle.ground import GroundObservation
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import MapFeatures
from autowaze.world.features import CameraFeatures
from autowaze.world.ground import CELL_M
from autowaze.world.labels import is_vehicle
from autowaze.world.pose import transform

_MATCHED = len(Sight)
_SUPPORT_RANGE_M = 25.0
_STEREO_SIGMA_PX = 0.2  # of sub-pixel sparse stereo
_AROUND = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])  # cells: the feet of a vehicle may lie in the next one


class StoredFeatureWatch:
    """Counts matches and misses of stored features, those with descriptor by matching, the others by place.

    Args:
        stored: the map's features, sorted by id.
        known_radius_m: a feature of a vehicle this near to a stored one without descriptor stands for it.
        camera: that gives the features their depth.
    """

    def __init__(self, stored: MapFeatures, known_radius_m: float, camera: StereoCamera) -> None:
        self._stored = stored
        self._bf = camera.bf
        self._plain = np.flatnonzero(~stored.described)
        self._radius_m = known_radius_m
        self._described_seen = Tally()
        self._plain_seen = Tally()

    def add(
        self, tracked: TrackedFrame, features: CameraFeatures, ground: GroundObservation, landmarks: Landmarks
    ) -> None:
        """Count one localised frame; its dense depth tells what is hidden."""
        self._add_described(tracked, ground, landmarks)
        self._add_plain(tracked, features, ground)

    def looked_for(self, landmarks: Landmarks) -> LookedFor:
        """Every stored feature that was predicted visible, and what was seen in its place."""
        described = self._described(landmarks)
        row, table = self._plain_seen.table(_MATCHED + 1)
        plain = self._stored[row]
        return LookedFor(
            np.concatenate([described.map_id, plain.id]),
            np.concatenate([described.position, plain.position]),
            np.concatenate([described.instance_key, plain.instance_key]),
            np.concatenate([described.matched, table[:, _MATCHED]]),
            np.concatenate([described.sights, table[:, :_MATCHED]]),
        )

    def _add_described(self, tracked: TrackedFrame, ground: GroundObservation, landmarks: Landmarks) -> None:
        matched = tracked.landmark_id[tracked.landmark_id >= 0]
        self._described_seen.add(matched, _MATCHED)
        rows = landmarks.rows(np.setdiff1d(tracked.visible_id, matched))
        rows = rows[rows >= 0]
        rows = rows[landmarks.map_id[rows] != 0]
        sight = sight_of(landmarks.position[rows], tracked.T_map_cam, ground.depth, ground.camera)
        self._described_seen.add(landmarks.id[rows], sight)

    def _add_plain(self, tracked: TrackedFrame, features: CameraFeatures, ground: GroundObservation) -> None:
        """A vehicle that segmentation overlooks still stands there, but the ground under one that left is near, too:
        features that are on no vehicle count within half the radius.
        """
        offset = self._stored.position[self._plain] - tracked.T_map_cam[:3, 3]
        near = self._plain[np.einsum("ij,ij->i", offset, offset) < _SUPPORT_RANGE_M**2]
        if not len(near):
            return
        sight = sight_of(self._stored.position[near], tracked.T_map_cam, ground.depth, ground.camera)
        sight[_on_free_ground(self._stored.position[near], ground)] = Sight.THROUGH
        near, sight = near[sight != Sight.HIDDEN], sight[sight != Sight.HIDDEN]
        features = features[features.has_depth]
        seen, on_vehicle = transform(tracked.T_map_cam, features.position_cam), is_vehicle(features.label)
        places = self._stored.position[near]
        held = any_within(seen[on_vehicle], places, self._radius_m)
        held |= any_within(seen[~on_vehicle], places, self._radius_m / 2)
        told = held | (sight == Sight.THROUGH) | self._can_be_found(places, tracked)
        self._plain_seen.add(near[told], np.where(held, _MATCHED, sight)[told])

    def _can_be_found(self, places: NDArray[np.float64], tracked: TrackedFrame) -> NDArray[np.bool_]:
        """Which places (N, 3) are so near that a feature there would be seen, and put into the radius by stereo.

        Farther away it says nothing that there is none; only that one sees through does.
        """
        depth = (places - tracked.T_map_cam[:3, 3]) @ tracked.T_map_cam[:3, 2]
        farthest_m = float(np.sqrt(self._radius_m * self._bf / _STEREO_SIGMA_PX))
        return np.asarray(depth <= farthest_m)

    def _described(self, landmarks: Landmarks) -> LookedFor:
        ids, table = self._described_seen.table(_MATCHED + 1)
        rows = landmarks.rows(ids)
        keep = rows >= 0
        keep[keep] = landmarks.map_id[rows[keep]] != 0
        rows, table = rows[keep], table[keep]
        map_id = landmarks.map_id[rows]
        at = np.searchsorted(self._stored.id, map_id)
        return LookedFor(
            map_id,
            landmarks.position[rows],
            self._stored.instance_key[at],
            table[:, _MATCHED],
            table[:, :_MATCHED],
        )


def _on_free_ground(places: NDArray[np.float64], ground: GroundObservation) -> NDArray[np.bool_]:
    """Which places (N, 3) are over ground that the frame saw free, all around them: no vehicle stands there."""
    cells = np.floor(places[:, :2] / CELL_M).astype(np.int64) + _AROUND[:, None]
    free = np.flatnonzero(ground.free)
    code = ground.ix[free].astype(np.int64) << 32 ^ ground.iy[free]
    return np.asarray(np.isin(cells[..., 0] << 32 ^ cells[..., 1], code).all(axis=0))
