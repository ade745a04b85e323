"""A car that no stored map holds lays what it tells onto the parking map, by the vehicles that stand in its rows.

Each window is moved by what the vehicles passed so far show odometry to be off (`world.row_registration`), and smoothed
within itself; what has been sent is not taken back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from autowaze.world.displacement import displaced
from autowaze.world.identity import MAX_INSTANCE
from autowaze.world.labels import ClassLabel, is_vehicle
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.row_registration import MIN_POINTS, MapShift, ParkedBoxes, shifts_along
from autowaze.world.spot_shapes import measured
from autowaze.world.visible_side import USUAL_SIZE_M, fitted_boxes

_LEAST_SIGMA_M = 0.05
_MOST_SIGMA_M = 0.3
"""A place known no better may be a bay off, and rows of bays look the same one bay on."""
_ROW_REACH_M = 6.0
"""A vehicle farther from the middle of every spot stands in no row."""


class RowRegistration:
    """Follows how far odometry is off, window by window.

    Args:
        spots: where people park, in the car's map frame; None where it does not know.
    """

    def __init__(self, spots: ParkingMap | None) -> None:
        self._shift: MapShift | None = None
        self._place = np.zeros(2)
        self.look_after(spots)

    def look_after(self, spots: ParkingMap | None) -> None:
        """Go by these spots from the next window on."""
        self._tree: cKDTree | None = None
        if spots is not None and len(spots):
            _, self._centre, _, _, self._heading = measured(np.array([s.polygon for s in spots.spots], np.object_))
            self._tree = cKDTree(self._centre)

    def registered(
        self, diff: SemanticMapDiff, path: NDArray[np.float64], sigma_m: float | None, is_held: bool
    ) -> SemanticMapDiff:
        """The diff of the next window, laid onto the parking map; as it is where the stored map held the pose.

        Args:
            diff: of the window.
            path: (F, 2) of the car in the window, to its end.
            sigma_m: standard deviation of the place at the window's beginning; None where the car was lost in between.
            is_held: whether the stored map held the pose.
        """
        before, self._place = self._place, path[-1] if len(path) else self._place
        if is_held:
            self._shift = MapShift.at_start(_LEAST_SIGMA_M)
        elif sigma_m is None or not len(path):
            self._shift = None
        elif self._tree is not None:
            if self._shift is None and sigma_m <= _MOST_SIGMA_M:
                self._shift, before = MapShift.at_start(max(sigma_m, _LEAST_SIGMA_M)), path[0]
            if self._shift is not None:
                path = np.vstack([before, path])
                shifts, self._shift = shifts_along(path, self._parked(diff, path), self._centre, self._shift)
                return displaced(diff, path, shifts)
        return diff

    def _parked(self, diff: SemanticMapDiff, path: NDArray[np.float64]) -> ParkedBoxes:
        """Vehicles of a diff that stand in a row, as their points alone say."""
        assert self._tree is not None
        new = diff.new[is_vehicle(diff.new.label) & (diff.new.instance_key != 0)]
        new = new[np.argsort(new.instance_key, kind="stable")]
        keys, starts, sizes = np.unique(new.instance_key, return_index=True, return_counts=True)
        points = np.ascontiguousarray(new.position[:, :2])
        middle = np.array([points[a : a + n].mean(axis=0) for a, n in zip(starts, sizes, strict=True)]).reshape(-1, 2)
        off, spot = map(np.asarray, self._tree.query(middle, distance_upper_bound=_ROW_REACH_M))
        rows = np.flatnonzero((sizes >= MIN_POINTS) & np.isfinite(off))
        seen = np.asarray(cKDTree(path).query(middle[rows])[1], dtype=np.int64)
        view = _unit(middle[rows] - path[seen])
        told = {number: row for row, number in enumerate(diff.instances.id.tolist())}
        ids = (keys[rows] & np.uint64(MAX_INSTANCE - 1)).tolist()
        mean_view = [diff.instances.view_direction[told[k]] if k in told else np.zeros(2) for k in ids]
        view += np.array(mean_view, np.float64).reshape(-1, 2)
        usual = [USUAL_SIZE_M[ClassLabel(int(new.label[start]))] for start in starts[rows]]
        table = fitted_boxes(
            points,
            starts[rows],
            sizes[rows],
            view / np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1.0),
            np.array(usual, np.float64).reshape(-1, 2),
            self._heading[spot[rows]],
        )
        return ParkedBoxes(table[:, :2], table[:, 4], sizes[rows], seen)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-6))
