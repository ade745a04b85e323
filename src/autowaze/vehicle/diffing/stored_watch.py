"""What the frames of a window say about the stored features that they should have seen."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing.novelty import any_within
from autowaze.vehicle.diffing.removal import LookedFor
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
_LEAST_DEPTH_M = 0.1
_CORNERS_APART_PX = 20.0
"""How far apart corners of a vehicle are found in the image. In unchanged streets a corner was found again within the
radius in 0.88 of the frames (KITTI rig) and 0.85 (ZED 2i) where it takes 25 to 30 pixels in the image, 0.83 and 0.68 at
20 to 25, 0.66 and 0.40 at 15 to 20, 0.40 and 0.17 at 10 to 15."""
_AROUND = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))  # cells: the feet of a vehicle may lie in the next one


class StoredFeatureWatch:
    """Counts matches and misses of stored features, those with descriptor by matching, the others by place.

    Args:
        stored: the map's features, sorted by id.
        known_radius_m: a feature of a vehicle this near to a stored one without descriptor stands for it.
        camera: that finds the features and gives them their depth.
    """

    def __init__(self, stored: MapFeatures, known_radius_m: float, camera: StereoCamera) -> None:
        self._stored = stored
        self._camera = camera
        self._plain = np.flatnonzero(~stored.described)
        self._plain_position = stored.position[self._plain]
        self._radius_m = known_radius_m
        self._seen = np.zeros((len(stored), _MATCHED + 1))  # frames by `Sight`, and those that matched, weighted

    def add(
        self, tracked: TrackedFrame, features: CameraFeatures, ground: GroundObservation, landmarks: Landmarks
    ) -> None:
        """Count one localised frame; its dense depth tells what is hidden."""
        self._add_described(tracked, ground, landmarks)
        self._add_plain(tracked, features, ground)

    def looked_for(self) -> LookedFor:
        """Every stored feature that was predicted visible, and what was seen in its place."""
        rows = np.flatnonzero(self._seen.any(axis=1))
        stored, seen = self._stored[rows], self._seen[rows]
        return LookedFor(stored.id, stored.position, stored.instance_key, seen[:, _MATCHED], seen[:, :_MATCHED])

    def _add_described(self, tracked: TrackedFrame, ground: GroundObservation, landmarks: Landmarks) -> None:
        found = self._rows(landmarks, landmarks.rows(tracked.landmark_id[tracked.landmark_id >= 0]))
        np.add.at(self._seen[:, _MATCHED], found, 1)
        missed = self._rows(landmarks, landmarks.rows(tracked.visible_id))
        is_found = np.zeros(len(self._stored), np.bool_)
        is_found[found] = True
        missed = missed[~is_found[missed]]
        sight = sight_of(self._stored.position[missed], tracked.T_map_cam, ground.depth, ground.camera)
        self._seen[missed, sight] += 1

    def _rows(self, landmarks: Landmarks, landmark_rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows in the stored map of those landmarks that are of it; -1 stands for one that is no more."""
        map_id = landmarks.map_id[landmark_rows[landmark_rows >= 0]]
        return np.asarray(np.searchsorted(self._stored.id, map_id[map_id != 0]))

    def _add_plain(self, tracked: TrackedFrame, features: CameraFeatures, ground: GroundObservation) -> None:
        """A vehicle that segmentation overlooks still stands there, but the ground under one that left is near, too:
        features that are on no vehicle count within half the radius.
        """
        offset = self._plain_position - tracked.T_map_cam[:3, 3]
        is_near = np.einsum("ij,ij->i", offset, offset) < _SUPPORT_RANGE_M**2
        near, places = self._plain[is_near], self._plain_position[is_near]
        if not len(near):
            return
        sight = sight_of(places, tracked.T_map_cam, ground.depth, ground.camera)
        sight[_on_free_ground(places, ground)] = Sight.THROUGH
        in_sight = sight != Sight.HIDDEN
        near, places, sight = near[in_sight], places[in_sight], sight[in_sight]
        weight = self._how_surely_found(places, tracked)
        rows = np.flatnonzero(features.has_depth)
        seen, on_vehicle = transform(tracked.T_map_cam, features.position_cam[rows]), is_vehicle(features.label[rows])
        held = any_within(seen[on_vehicle], places, self._radius_m)
        held |= any_within(seen[~on_vehicle], places, self._radius_m / 2)
        weight[~held & (sight == Sight.THROUGH)] = 1.0
        self._seen[near, np.where(held, _MATCHED, sight)] += weight

    def _how_surely_found(self, places: NDArray[np.float64], tracked: TrackedFrame) -> NDArray[np.float64]:
        """How much (N,) it says of places (N, 3) whether a corner was found within the radius, 0 to 1.

        A frame counts less where the radius holds less of the image than one corner has to itself: as the logarithm of
        how often a standing vehicle shows none, log(1 - found), falls off (`_CORNERS_APART_PX`). It does not count
        where stereo does not put a corner into the radius. That one sees through tells from farther away, too.
        """
        depth = np.maximum((places - tracked.T_map_cam[:3, 3]) @ tracked.T_map_cam[:3, 2], _LEAST_DEPTH_M)
        radius_px = self._camera.fx * self._radius_m / depth
        by_stereo = depth <= np.sqrt(self._radius_m * self._camera.bf / _STEREO_SIGMA_PX)
        return np.asarray(by_stereo * np.minimum(radius_px / _CORNERS_APART_PX, 1.0) ** 3)


def _on_free_ground(places: NDArray[np.float64], ground: GroundObservation) -> NDArray[np.bool_]:
    """Which places (N, 3) are over ground that the frame saw free, all around them: no vehicle stands there."""
    if not ground.free.any():
        return np.zeros(len(places), np.bool_)
    free = np.column_stack([ground.ix, ground.iy])[ground.free]
    low = free.min(axis=0) - 1
    grid = np.zeros(free.max(axis=0) - low + 2, np.uint8)
    grid[tuple((free - low).T)] = 1
    grid = cv2.erode(grid, _AROUND)
    at = np.floor(places[:, :2] / CELL_M).astype(np.int64) - low
    inside = ((at >= 0) & (at < grid.shape)).all(axis=1)
    at[~inside] = 0  # a corner of the rim, which is not free
    return np.asarray(grid[at[:, 0], at[:, 1]] > 0)
