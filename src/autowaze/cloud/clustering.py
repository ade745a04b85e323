"""Features -> groups by density alone, as the baselines do without instance ids (thesis, sec. 4.1.4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

from autowaze.cloud.grouping import VehicleGroups
from autowaze.cloud.instances import InstanceViews
from autowaze.cloud.spots import SpotIndex
from autowaze.world.feature_map import MapFeatures
from autowaze.world.labels import ClassLabel, is_vehicle

NEAR_SPOT_M = 1.0
EPS_M, MIN_SAMPLES = 0.5, 5


def cluster_by_density(features: MapFeatures, spots: SpotIndex, vehicles_only: bool) -> VehicleGroups:
    """DBSCAN over the x, y of all features (N rows) near the spots; costs the whole map."""
    if vehicles_only:
        features = features[is_vehicle(features.label)]
    features = features[spots.near(features.position[:, :2], NEAR_SPOT_M)]
    cluster = _dbscan(features.position[:, :2])
    member = np.argsort(cluster, kind="stable")[np.count_nonzero(cluster < 0) :]
    features, cluster = features[member], cluster[member]
    count = int(cluster.max(initial=-1)) + 1
    seen_at = np.zeros(count)
    np.maximum.at(seen_at, cluster, features.last_seen)
    views = InstanceViews(
        key=np.arange(1, count + 1, dtype=np.uint64),
        label=np.full(count, ClassLabel.CAR, np.uint8),
        confidence=np.full(count, 0.5),
        view_direction=np.zeros((count, 2)),
        frames=np.zeros(count, np.int64),
        seen_at=seen_at,
    )
    return VehicleGroups(features.position, cluster, views)


def _dbscan(points: NDArray[np.float64]) -> NDArray[np.int64]:
    if len(points) == 0:
        return np.zeros(0, np.int64)
    return np.asarray(DBSCAN(eps=EPS_M, min_samples=MIN_SAMPLES).fit(points).labels_, dtype=np.int64)
