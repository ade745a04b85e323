"""The whole cloud in one page (thesis, Fig. 3.6): a semantic map diff in, spots and a map update out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.boxes import boxes_of_average_size
from autowaze.cloud.broadcast import ChangeLog, MapUpdate, Update
from autowaze.cloud.ground_votes import GroundVotes
from autowaze.cloud.grouping import group_by_instance
from autowaze.cloud.integration import MapState
from autowaze.cloud.occupancy import vacant_rectangles
from autowaze.cloud.outliers import remove_outliers
from autowaze.cloud.scene import VehicleScene
from autowaze.cloud.spots import SpotIndex
from autowaze.cloud.stage_times import StageTimes
from autowaze.cloud.two_pass import decide_two_pass
from autowaze.cloud.validation import check_diff
from autowaze.world.feature_map import FeatureMap
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import Occupancy, ParkingMap, SpotState
from autowaze.world.vehicles import VehicleBoxes
from autowaze.world.wire import decode_diff


class CloudService:
    """Keeps the map true and knows which spots are free."""

    def __init__(self, spots: ParkingMap, method: str = "thesis", base_map: FeatureMap | None = None) -> None:
        self.spots = SpotIndex(spots)
        self.map = MapState(base_map, spots.georeference)
        self.ground = GroundVotes(self.spots)
        self.scene = VehicleScene()
        self.changes = ChangeLog(self.map.version)
        self.times = StageTimes()
        self._states = [SpotState(spot_id, Occupancy.UNKNOWN) for spot_id in self.spots.ids]

    def receive(self, payload: bytes) -> Update:
        """Take in the bytes of one diff.

        Raises:
            WireError: they are no diff, or one that says something impossible; nothing has changed.
        """
        with self.times.stage("decode"):
            diff = decode_diff(payload)
        return self.integrate(diff)

    def integrate(self, diff: SemanticMapDiff) -> Update:
        """Take in one diff; raises `WireError` as `receive` does."""
        with self.times.stage("integration"):
            check_diff(diff, self.map.georeference)
            change = self.map.integrate(diff)
            if change is None:
                return Update(False, self.map.version, (), [], self.changes.nothing())
            touched = [self.ground.add(diff)]
        with self.times.stage("grouping"):
            groups = group_by_instance(self.map, change.instances)
        with self.times.stage("outliers"):
            groups = remove_outliers(groups)
        with self.times.stage("boxes"):
            boxes = boxes_of_average_size(groups, self.spots)
            for moved in (self.scene.of(change.instances), boxes):
                touched.append(self.spots.overlapping(moved.polygons)[1])
            self.scene.replace(change.instances, boxes)
        with self.times.stage("occupancy"):
            spots = np.unique(np.concatenate(touched))
            changed = self._adopt(spots, decide_two_pass(spots, self.spots, self.scene, self.ground))
        with self.times.stage("broadcast"):
            return Update(True, self.map.version, changed, self._vacant(spots), self.changes.append(change))

    @property
    def states(self) -> list[SpotState]:
        """State of every spot, in the order of the parking map."""
        return list(self._states)

    @property
    def vehicle_boxes(self) -> VehicleBoxes:
        """Every vehicle on the map, sorted by group."""
        return self.scene.boxes

    @property
    def feature_map(self) -> FeatureMap:
        """The stored map, features sorted by id; costs the whole map."""
        return FeatureMap(self.map.features, self.map.georeference, self.map.version)

    def vacant(self) -> list[dict[str, float]]:
        """Rectangles {x, y, width, height} of all vacant spots (thesis, sec. 3.3.6)."""
        return self._vacant(np.arange(len(self.spots)))

    def map_update_since(self, version: int) -> MapUpdate:
        """What a car with this version of the map lacks; raises `OutdatedMapError` if it must fetch it whole."""
        return self.changes.since(version)

    def _adopt(self, spots: NDArray[np.int64], states: list[SpotState]) -> tuple[SpotState, ...]:
        changed = []
        for spot, state in zip(spots.tolist(), states, strict=True):
            if state != self._states[spot]:
                self._states[spot] = state
                changed.append(state)
        return tuple(changed)

    def _vacant(self, spots: NDArray[np.int64]) -> list[dict[str, float]]:
        vacant = [spot for spot in spots.tolist() if self._states[spot].occupancy is Occupancy.VACANT]
        return vacant_rectangles(self.spots.polygons[vacant])
