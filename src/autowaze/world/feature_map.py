"""The stored 3D feature map, the thesis's m."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from autowaze.world.columns import Columns
from autowaze.world.features import DESCRIPTOR_BYTES
from autowaze.world.georeference import Georeference


@dataclass
class MapFeatures(Columns):
    """Features of the map, N rows.

    Attributes:
        id: (N,) uint64, unique for ever; 0 is never used.
        position: (N, 3) float64, metres in the map frame (east, north, up).
        descriptor: (N, 32) uint8.
        normal: (N, 3) float32, mean unit vector from the feature towards the cameras that saw it, map frame.
        min_distance, max_distance: (N,) float32, metres between which its ORB scale can be detected.
        label: (N,) uint8, a `ClassLabel`.
        instance_key: (N,) uint64, which instance of which vehicle session; 0 for none.
        first_seen, last_seen: (N,) float64, seconds since the epoch (UTC).
        observations: (N,) uint16, frames that matched it, saturating.
    """

    id: NDArray[np.uint64]
    position: NDArray[np.float64]
    descriptor: NDArray[np.uint8]
    normal: NDArray[np.float32]
    min_distance: NDArray[np.float32]
    max_distance: NDArray[np.float32]
    label: NDArray[np.uint8]
    instance_key: NDArray[np.uint64]
    first_seen: NDArray[np.float64]
    last_seen: NDArray[np.float64]
    observations: NDArray[np.uint16]

    @property
    def described(self) -> NDArray[np.bool_]:
        """Rows (N,) that carry a descriptor; an all-zero one stands for none."""
        return np.asarray(self.descriptor.any(axis=1))

    @classmethod
    def empty(cls) -> MapFeatures:
        """No features."""
        f32 = np.float32
        return cls(
            id=np.zeros(0, np.uint64),
            position=np.zeros((0, 3)),
            descriptor=np.zeros((0, DESCRIPTOR_BYTES), np.uint8),
            normal=np.zeros((0, 3), f32),
            min_distance=np.zeros(0, f32),
            max_distance=np.zeros(0, f32),
            label=np.zeros(0, np.uint8),
            instance_key=np.zeros(0, np.uint64),
            first_seen=np.zeros(0),
            last_seen=np.zeros(0),
            observations=np.zeros(0, np.uint16),
        )


@dataclass
class FeatureMap:
    """The map a car carries and the cloud keeps true.

    Attributes:
        features: the rows, sorted by id.
        georeference: where the map frame lies on the Earth; None for a map that floats freely.
        version: counts the diffs that were integrated.
    """

    features: MapFeatures = field(default_factory=MapFeatures.empty)
    georeference: Georeference | None = None
    version: int = 0

    def __len__(self) -> int:
        return len(self.features)

    def near(self, position: NDArray[np.floating], radius_m: float) -> MapFeatures:
        """Features within a horizontal radius of a map position (x, y[, z])."""
        offset = self.features.position[:, :2] - np.asarray(position, dtype=np.float64)[:2]
        return self.features[np.einsum("ij,ij->i", offset, offset) <= radius_m**2]
