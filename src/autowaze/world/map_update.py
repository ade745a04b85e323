"""What brings a stored map from one version to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.georeference import Georeference


@dataclass(frozen=True)
class MapUpdate:
    """What brings a map from one version to another.

    Attributes:
        added: features to insert.
        removed: (R,) uint64, sorted ids to take out; disjoint from `added`.
        georeference: of the map frame, where it is stated.
    """

    from_version: int
    to_version: int
    added: MapFeatures
    removed: NDArray[np.uint64]
    georeference: Georeference | None = None

    def applied_to(self, feature_map: FeatureMap) -> FeatureMap:
        """The map as of the newer version, features sorted by id.

        Raises:
            AutowazeError: the map is of another version than the update starts from.
        """
        if feature_map.version != self.from_version:
            raise AutowazeError(
                f"the update leads from map version {self.from_version}, the map is of version {feature_map.version}: "
                "fetch the updates since that version"
            )
        outdated = np.concatenate([self.removed, self.added.id])
        kept = feature_map.features[~np.isin(feature_map.features.id, outdated)]
        features = MapFeatures.concatenate([kept, self.added])
        ordered = features[np.argsort(features.id, kind="stable")]
        return FeatureMap(ordered, feature_map.georeference, self.to_version)
