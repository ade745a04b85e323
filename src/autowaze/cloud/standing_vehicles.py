"""From the features of instances to the vehicles that stand: groups, boxes, and which of them are there now."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.boxes import ROW_REACH_M, boxes_of_average_size
from autowaze.cloud.clustering import cluster_by_density
from autowaze.cloud.grouping import VehicleGroups, group_by_instance, split_in_space
from autowaze.cloud.integration import MapState
from autowaze.cloud.methods import Method
from autowaze.cloud.outliers import remove_outliers
from autowaze.cloud.parked_vehicles import ParkedVehicles
from autowaze.cloud.rejoining import rejoin_parts
from autowaze.cloud.row_split import split_along_rows
from autowaze.cloud.scene import VehicleScene
from autowaze.cloud.spots import SpotIndex
from autowaze.cloud.visible_side import boxes_from_visible_side
from autowaze.world.feature_map import FeatureMap
from autowaze.world.labels import is_vehicle
from autowaze.world.vehicles import VehicleBoxes


class StandingVehicles:
    """Follows the map, a few instances at a time.

    Args:
        method: how vehicles are told from features.
        state: the map.
        spots: the spots, whose rows vehicles stand along.

    Attributes:
        scene: a box per group of features.
        parked: vehicles merged from these, for methods that believe.
    """

    def __init__(self, method: Method, state: MapState, spots: SpotIndex) -> None:
        self.scene = VehicleScene()
        self.parked = ParkedVehicles(spots)
        self._method, self._state, self._spots = method, state, spots

    def group(self, instances: NDArray[np.uint64]) -> VehicleGroups:
        """Features of these instances (K,), ascending, that belong together; of all where ids do not count."""
        if not self._method.instance_ids:
            return cluster_by_density(self._state.features, self._spots, self._method.labels)
        return group_by_instance(self._state, instances)

    def without_outliers(self, groups: VehicleGroups) -> VehicleGroups:
        """The groups without what lies apart, for methods that care."""
        return remove_outliers(groups) if self._method.outlier_removal else groups

    def draw(self, groups: VehicleGroups) -> VehicleBoxes:
        """Boxes around groups."""
        if self._method.visible_side:
            parts = split_along_rows(split_in_space(groups), self._spots)
            boxes = boxes_from_visible_side(parts, self._spots)
            wholes = rejoin_parts(parts, boxes)
            return boxes if wholes is parts else boxes_from_visible_side(wholes, self._spots)
        return boxes_of_average_size(groups, self._spots)

    def place(self, instances: NDArray[np.uint64], boxes: VehicleBoxes) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
        """Put new boxes of these instances (K,) in place of the old ones.

        Returns:
            The groups (M,) of boxes old and new, and the spots (M,) that each touches.
        """
        old = instances if self._method.instance_ids else self.scene.boxes.group
        before = self.scene.of(old)
        self.stand(old, boxes)
        moved = VehicleBoxes.concatenate([before, boxes])
        row, spot, _ = self._spots.grid.overlaps(moved.corners)
        return moved.group[row], spot

    def stand(self, groups: NDArray[np.uint64], boxes: VehicleBoxes) -> None:
        """Forget the boxes of these groups (K,) and put these in their place."""
        self.scene.replace(groups, boxes)
        if self._method.belief:
            self.parked.replace(groups, boxes)

    def stand_as_mapped(self, base_map: FeatureMap | None) -> None:
        """Put boxes where the base map has vehicles.

        A car that finds one of them where it was has nothing new to tell of it, nor of another in its place.
        """
        if base_map is None or not self._method.instance_ids:
            return
        features = base_map.features
        keys = np.unique(features.instance_key[is_vehicle(features.label)])
        boxes = self._boxes_of(keys[keys > 0])
        self.stand(np.unique(boxes.group), boxes)

    def turn(self, spot: int) -> None:
        """Draw the boxes around a new spot anew: vehicles stand as the spots next to them do."""
        around = self._spots.bounds[spot] + np.array([-ROW_REACH_M, -ROW_REACH_M, ROW_REACH_M, ROW_REACH_M])
        instances = np.unique(self.scene.near(around[None]).group)
        self.place(instances, self._boxes_of(instances))

    def _boxes_of(self, instances: NDArray[np.uint64]) -> VehicleBoxes:
        return self.draw(self.without_outliers(self.group(instances)))
