"""Vehicle features -> one group of points per vehicle (thesis, sec. 3.3.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.instances import InstanceViews
from autowaze.cloud.integration import MapState
from autowaze.cloud.neighbours import number_parts
from autowaze.cloud.vehicle_features import VehicleFeatures
from autowaze.world.labels import VEHICLES, is_vehicle

SPLIT_GAP_M = 0.6


@dataclass(frozen=True)
class VehicleGroups:
    """Points that belong together.

    Attributes:
        position: (P, 3) float64, metres in the map frame.
        group: (P,) int64, ascending: row in `views` of each point's group.
        views: (G,) what is known of each group; a group may have no points.
    """

    position: NDArray[np.float64]
    group: NDArray[np.int64]
    views: InstanceViews

    def __len__(self) -> int:
        return len(self.views)

    def keep(self, points: NDArray[np.bool_]) -> VehicleGroups:
        """The same groups with only these points (P,)."""
        return replace(self, position=self.position[points], group=self.group[points])

    @property
    def starts(self) -> NDArray[np.int64]:
        """Bounds (G + 1,): the points of group g are rows starts[g] to starts[g + 1]."""
        return np.searchsorted(self.group, np.arange(len(self) + 1))

    @property
    def sizes(self) -> NDArray[np.int64]:
        """Points (G,) of each group."""
        return np.bincount(self.group, minlength=len(self))

    @property
    def centroids(self) -> NDArray[np.float64]:
        """Mean x, y (G, 2) of each group; NaN without points."""
        sums = [np.bincount(self.group, self.position[:, axis], len(self)) for axis in (0, 1)]
        with np.errstate(invalid="ignore"):
            return np.stack(sums, axis=1) / self.sizes[:, None]


def group_by_instance(state: MapState, instances: NDArray[np.uint64]) -> VehicleGroups:
    """Partition the vehicle features of these instances (K,) by their instance; of one that left no points remain."""
    features = state.vehicle_features(instances)
    features = features[np.argsort(features.instance_key, kind="stable")]
    group = np.searchsorted(instances, features.instance_key).astype(np.int64)
    stands = ~state.has_left(instances, np.bincount(group, minlength=len(instances)))[group]
    features, group = features[stands], group[stands]
    views = _filled_in(state.instances.views(instances), features, group)
    return VehicleGroups(features.position, group, views)


def split_in_space(groups: VehicleGroups, gap_m: float = SPLIT_GAP_M) -> VehicleGroups:
    """Make parts of a group that no chain of points links into groups of their own.

    In a dense row a track may jump to the next car; the gap between the two shows it.
    """
    part = number_parts(np.ascontiguousarray(groups.position[:, :2]), groups.starts, gap_m)
    first = np.unique(part, return_index=True)[1]
    order = np.argsort(part, kind="stable")
    return VehicleGroups(groups.position[order], part[order], groups.views[groups.group[first]])


def _filled_in(views: InstanceViews, features: VehicleFeatures, group: NDArray[np.int64]) -> InstanceViews:
    """What no instance summary told (a base map has none) comes from the features themselves."""
    told = is_vehicle(views.label) & (views.view_direction != 0).any(axis=1) & (views.seen_at > 0)
    if told.all():
        return views
    count = len(views)
    votes = np.zeros((count, max(VEHICLES) + 1), np.int64)
    np.add.at(votes, (group, features.label), 1)
    label = np.where(is_vehicle(views.label), views.label, votes.argmax(axis=1)).astype(np.uint8)
    last_seen = np.zeros(count)
    np.maximum.at(last_seen, group, features.last_seen)
    towards = np.stack([np.bincount(group, -features.normal[:, axis], count) for axis in (0, 1)], axis=1)
    norm = np.linalg.norm(towards, axis=1, keepdims=True)
    untold = (views.view_direction == 0).all(axis=1, keepdims=True)
    return replace(
        views,
        label=label,
        view_direction=np.where(untold & (norm > 0), towards / np.maximum(norm, 1e-12), views.view_direction),
        seen_at=np.where(views.seen_at > 0, views.seen_at, last_seen),
    )
