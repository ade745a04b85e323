"""Vehicles that left: how many features of each instance have been removed, and whether what remains is but a rest.

A car removes what it looked for and missed. Features that were hidden from it, or so far off that stereo tells little,
stay in the map after the vehicle has gone, a few here and there, and must not pass for a vehicle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world.feature_map import MapFeatures
from autowaze.world.labels import is_vehicle

MOST_REMOVED = 0.75
"""Share of a vehicle's features from which on it has left. Half is too few: one id may hold two, one of which left."""


class RemovedOfInstances:
    """Counts by instance, the same for the same set of diffs in any order."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}

    def note(self, gone: MapFeatures) -> None:
        """Count features that are in the map no more, or never were because their removal came first."""
        keys = gone.instance_key[is_vehicle(gone.label) & (gone.instance_key != 0)]
        for key, count in zip(*(column.tolist() for column in np.unique(keys, return_counts=True)), strict=True):
            self._counts[key] = self._counts.get(key, 0) + count

    def has_left(self, instances: NDArray[np.uint64], remaining: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether the vehicles of these instances (K,), of which so many features (K,) remain, are there no more."""
        removed = np.array([self._counts.get(key, 0) for key in instances.tolist()], np.int64)
        return np.asarray((removed > 0) & (removed >= MOST_REMOVED * (removed + remaining)))

    def forget(self, key: int) -> None:
        """Drop the count of an instance."""
        self._counts.pop(key, None)

    def kept(self) -> dict[int, int]:
        """What it holds, for a snapshot."""
        return dict(self._counts)

    def restore(self, kept: dict[int, int]) -> None:
        """Hold what a snapshot kept."""
        self._counts = dict(kept)
