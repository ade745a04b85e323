"""What boxes are drawn from: the map's features of vehicles, without what only localisation needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.diff_kernels import any_of
from autowaze.world.columns import Columns
from autowaze.world.feature_map import MapFeatures
from autowaze.world.labels import is_vehicle


@dataclass
class VehicleFeatures(Columns):
    """N rows; columns as in `MapFeatures`."""

    position: NDArray[np.float64]
    instance_key: NDArray[np.uint64]
    label: NDArray[np.uint8]
    normal: NDArray[np.float32]
    last_seen: NDArray[np.float64]

    @classmethod
    def empty(cls) -> VehicleFeatures:
        """No rows."""
        none = np.zeros(0)
        return cls(np.zeros((0, 3)), np.zeros(0, np.uint64), np.zeros(0, np.uint8), np.zeros((0, 3), np.float32), none)

    @classmethod
    def of(cls, features: MapFeatures, instances: NDArray[np.uint64]) -> VehicleFeatures:
        """Those with a vehicle's label that belong to these instances (K,)."""
        rows = np.flatnonzero(is_vehicle(features.label) & any_of(features.instance_key, instances))
        return cls(
            features.position[rows],
            features.instance_key[rows],
            features.label[rows],
            features.normal[rows],
            features.last_seen[rows],
        )
