"""Parked vehicles out of sight, known again where they stand: the gallery of re-identification, by place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from autowaze.vehicle.semantics.drift import DriftHistogram
from autowaze.vehicle.semantics.whereabouts import Sightings

_SIZE, _FRAMES = 150, 1200
"""So many vehicles are kept, and for so many frames: two minutes, in which odometry drifts little."""
_FLOOR_M = 0.4  # however often a vehicle was seen
_MAX_SIGMA_M = 1.0
_REACH_M = 6.0
_SAME_M = 1.0  # less than this apart is one vehicle
_NEW_PER_M2 = 1e-3  # of vehicles never seen before, where others are known
_UNEXPLAINED_PER_M2 = 0.03
_SHARE = 0.2  # of what one frame tells of the drift: the next ones err alike
_MAX_DRIFT_SIGMA_M = 0.7
_HALF_A_BAY_M = 1.4
_MIN_MARGIN = 1.0  # logarithm by which a vehicle must be likelier than any other


class Gallery:
    """Places of vehicles that have left the view, in the ground plane of the tracks.

    From the far end of an aisle the odometry has drifted by half a bay, and every vehicle has a neighbour one bay
    on. What all the vehicles in view say together of the drift is kept as a histogram; while it is wide or has two
    peaks, and where two vehicles would fit, nothing is known again.
    """

    def __init__(self) -> None:
        self._id = np.zeros(0, np.int32)
        self._place = np.zeros((0, 2))
        self._covariance = np.zeros((0, 2, 2))
        self._last_seen = np.zeros(0, np.int64)
        self._drift = DriftHistogram()

    def __len__(self) -> int:
        return len(self._id)

    def put(
        self,
        ids: NDArray[np.int32],
        place: NDArray[np.float64],
        covariance: NDArray[np.float64],
        first_seen: NDArray[np.int64],
        last_seen: NDArray[np.int64],
    ) -> None:
        """Remember vehicles (n) that left the view, by place (n, 2) and covariance (n, 2, 2), if they are well placed.

        One in the place of another that it was never seen together with is that one under a new id.
        """
        precise = np.linalg.eigvalsh(covariance)[:, -1] < _MAX_SIGMA_M**2
        ids, place, covariance = ids[precise], place[precise] + self._drift.mean, covariance[precise]
        apart = np.linalg.norm(place[:, None] - self._place[None], axis=2)
        same = (apart < _SAME_M) & (self._last_seen[None, :] < first_seen[precise][:, None])
        self._keep(~(same.any(axis=0) | np.isin(self._id, ids)))
        self._id = np.concatenate([self._id, ids])[-_SIZE:]
        self._place = np.concatenate([self._place, place])[-_SIZE:]
        self._covariance = np.concatenate([self._covariance, covariance])[-_SIZE:]
        self._last_seen = np.concatenate([self._last_seen, last_seen[precise]])[-_SIZE:]

    def forget(self, frame: int) -> None:
        """Drop what has been out of sight for long by the frame of this number."""
        if len(self) and self._last_seen.min() < frame - _FRAMES:
            self._keep(self._last_seen >= frame - _FRAMES)

    def correct_drift(self, seen: Sightings) -> None:
        """Learn of the drift by vehicles in view, whatever ids they have."""
        if not len(self):
            return
        self._drift.walk()
        seen = seen[seen.good]
        d, _, density = self._densities(seen)
        if len(d):
            explained = np.zeros((len(seen), density.shape[1]))
            np.add.at(explained, d, density)
            self._drift.update(_SHARE * np.log(_UNEXPLAINED_PER_M2 + explained[np.unique(d)]).sum(axis=0))

    def recognise(self, seen: Sightings, taken: NDArray[np.int32]) -> NDArray[np.int32]:
        """Ids (D,) of the vehicles that have come into view, 0 for one that is new or cannot be told from another.

        Args:
            seen: the vehicles, and `taken` the ids of those that are in view.
        """
        ids = np.zeros(len(seen), np.int32)
        if not len(self) or not len(seen) or self._drift.sigma > _MAX_DRIFT_SIGMA_M:
            return ids
        d, g, density = self._densities(seen)
        score = np.full((len(seen), len(self)), -np.inf)
        score[d, g] = np.log(np.maximum(density @ self._drift.probability, 1e-12) / _NEW_PER_M2)
        score[:, np.isin(self._id, taken)] = -np.inf
        rows, columns = linear_sum_assignment(np.maximum(score, 0.0), maximize=True)
        given = score[rows, columns] > 0
        for row, column in zip(rows[given], columns[given], strict=True):
            rivals = np.setdiff1d(np.arange(len(self)), columns[given])
            rival = max(0.0, score[row, rivals].max(initial=0.0))
            off = np.linalg.norm(seen.place[row] + self._drift.mean - self._place[column])
            if score[row, column] - rival > _MIN_MARGIN and off < _HALF_A_BAY_M:
                ids[row] = self._id[column]
        return ids

    def _densities(self, seen: Sightings) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Rows of what is seen and of the gallery (pairs,) within reach, and the density (pairs, offsets) per m^2."""
        apart = seen.place[:, None] + self._drift.mean - self._place[None]
        d, g = np.nonzero((apart**2).sum(axis=2) < _REACH_M**2)
        covariance = seen.covariance[d] + self._covariance[g] + 2 * _FLOOR_M**2 * np.eye(2)
        weight = np.linalg.inv(covariance)
        x, y = (seen.place[d] - self._place[g])[:, :, None].swapaxes(0, 1) + self._drift.offsets.T[:, None]
        squared = weight[:, 0, 0, None] * x**2 + 2 * weight[:, 0, 1, None] * x * y + weight[:, 1, 1, None] * y**2
        return d, g, np.exp(-squared / 2) / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))[:, None]

    def _keep(self, rows: NDArray[np.bool_]) -> None:
        self._id, self._place, self._covariance = self._id[rows], self._place[rows], self._covariance[rows]
        self._last_seen = self._last_seen[rows]
