"""The whole cloud in one page (thesis, Fig. 3.6): a semantic map diff in, spots and a map update out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.belief import believe
from autowaze.cloud.broadcast import ChangeLog, Update
from autowaze.cloud.evidence import evidence_of
from autowaze.cloud.ground_votes import GroundVotes
from autowaze.cloud.integration import MapState
from autowaze.cloud.map_tiles import SpotTiles
from autowaze.cloud.merging import merge_boxes
from autowaze.cloud.methods import FUSED, Method, method_named
from autowaze.cloud.occupancy import rectangles_within
from autowaze.cloud.snapshot import SnapshotError
from autowaze.cloud.spot_edits import SpotEdit
from autowaze.cloud.spots import SpotIndex
from autowaze.cloud.standing_vehicles import StandingVehicles
from autowaze.cloud.taken_diffs import NO_SPOTS, TakenDiff, Tidings
from autowaze.cloud.two_pass import decide_two_pass
from autowaze.cloud.validation import check_diff
from autowaze.cloud.witnesses import Witnesses
from autowaze.world.feature_map import FeatureMap
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.map_update import MapUpdate
from autowaze.world.parking import Occupancy, ParkingMap, SpotState
from autowaze.world.stage_times import StageTimes
from autowaze.world.tiles import Tile
from autowaze.world.vehicles import VehicleBoxes
from autowaze.world.wire import decode_diff

CROWDING_S = 600.0
"""How much older each earlier look of one source counts, when the newest of many are kept."""


class CloudService:
    """Keeps the map true and knows which spots are free.

    Args:
        spots: the pre-annotated spots; all diffs must be in their map frame.
        method: how spots are decided: `fused`, `thesis`, a baseline of `cloud.methods`, or a `Method` of your own.
        base_map: the stored map to start from.
    """

    def __init__(self, spots: ParkingMap, method: str | Method = FUSED, base_map: FeatureMap | None = None) -> None:
        self.method = method_named(method) if isinstance(method, str) else method
        self.spots = SpotIndex(spots)
        self.witnesses = Witnesses(base_map)
        self.map = MapState(base_map, spots.georeference, self.witnesses if self.method.corroboration else None)
        self.ground = GroundVotes(self.spots, CROWDING_S if self.method.corroboration else 0.0)
        self.vehicles = StandingVehicles(self.method, self.map, self.spots)
        self.changes = ChangeLog(self.map.version)
        self.spot_tiles = SpotTiles(self.spots.centre, spots.georeference, self.map.version)
        self.times = StageTimes()
        self._states = [SpotState(spot_id, Occupancy.UNKNOWN) for spot_id in self.spots.ids]
        self.vehicles.stand_as_mapped(base_map)

    def receive(self, payload: bytes) -> Update:
        """Take in the bytes of one diff.

        Raises:
            WireError: they are no diff, or one that says something impossible; nothing has changed.
        """
        with self.times.stage("decode"):
            diff = decode_diff(payload)
        return self.integrate(diff, len(payload))

    def integrate(self, diff: SemanticMapDiff, size: int = 0, source: int | None = None) -> Update:
        """Take in one diff.

        Args:
            diff: decoded.
            size: how many bytes it came as.
            source: whose word it is, the same for all sessions of one token; None takes each session for a source.

        Raises:
            WireError: as `receive`.
        """
        return self.settle([self.take(diff, size, source)])[0]

    def take(self, diff: SemanticMapDiff, size: int = 0, source: int | None = None) -> TakenDiff:
        """Let the map have a diff; `settle` has to follow, for this one or for several at once.

        Raises:
            WireError: as `receive`.
        """
        with self.times.stage("integration"):
            check_diff(diff, self.map.georeference)
            source = self.witnesses.note(diff.session, source)
            change = self.map.integrate(diff if self.method.removals else _additions_only(diff))
            looked_at = self.ground.add(diff, source) if change is not None else NO_SPOTS
            return TakenDiff(diff, size, self.map.version, change, looked_at)

    def settle(self, taken: Sequence[TakenDiff]) -> list[Update]:
        """Find out what diffs that the map has taken mean for vehicles and spots; one update for each.

        States follow from what the map knows, not from the order in which it came to know it: taking several diffs
        together ends where taking each by itself does, at a fraction of the cost. A spot that several of them bear on
        changes with the last of these.
        """
        tidings = Tidings.of(taken)
        count = len(tidings.taken)
        if count == 0:
            return [self._nothing_new(one) for one in taken]
        with self.times.stage("grouping", count):
            groups = self.vehicles.group(tidings.instances)
        with self.times.stage("outliers", count):
            groups = self.vehicles.without_outliers(groups)
        with self.times.stage("boxes", count):
            moved = self.vehicles.place(tidings.instances, self.vehicles.draw(groups))
        with self.times.stage("occupancy", count):
            spots, bearer = tidings.bearers(*moved)
            has_changed = self._adopt(spots, self._decide(spots))
        with self.times.stage("broadcast", count):
            told = {
                one.version: self._update(one, spots[bearer == row], spots[(bearer == row) & has_changed])
                for row, one in enumerate(tidings.taken)
            }
        return [self._nothing_new(one) if one.change is None else told[one.version] for one in taken]

    def edit(self, edit: SpotEdit) -> SpotState | None:
        """Draw or erase a spot; returns its state, judged by what is known of its ground and the vehicles there.

        The states of all other spots stay as they are.
        """
        spot = edit.spot(self.spots.georeference)
        if spot is None:
            if edit.spot_id in self.spots.row_of:
                row = self.spots.erase(edit.spot_id)
                self.ground.erased(row)
                self.spot_tiles.erase(row, self.map.version)
                del self._states[row]
            return None
        windows = self.ground.seen_in(spot.polygon)
        row = self.spots.draw(spot)
        self.ground.drawn(row, windows)
        self.spot_tiles.draw(row, self.spots.centre[row], self.map.version)
        self.vehicles.turn(row)
        self._states[row : row + 1] = self._decide(np.array([row]))
        return self._states[row]

    def kept(self) -> dict[str, Any]:
        """All that diffs have told it, for a snapshot; costs a copy of the tables, not of what is in them."""
        return {
            "method": repr(self.method),
            "base_version": self.map.base_version,
            "georeference": repr(self.map.georeference),
            "spots": self.spots.fingerprints(),
            "states": list(self._states),
            "map": self.map.kept(),
            "witnesses": self.witnesses.kept(),
            "ground": self.ground.kept(),
            "boxes": self.vehicles.scene.boxes,
            "changes": self.changes.kept(),
            "spot_tiles": [(*tile, version) for tile, version in self.spot_tiles.versions.items()],
        }

    def restore(self, kept: dict[str, Any]) -> bool:
        """Hold what a snapshot kept; spots that lay elsewhere then begin anew.

        Args:
            kept: by a service of the same method and base map.

        Returns:
            Whether all spots lie where they lay.

        Raises:
            SnapshotError: it is of another method or base map; nothing has changed.
        """
        for name, own in (
            ("method", repr(self.method)),
            ("base_version", self.map.base_version),
            ("georeference", repr(self.map.georeference)),
        ):
            if kept[name] != own:
                raise SnapshotError(f"the snapshot is of another {name.replace('_', ' ')} than this service")
        own_spots = self.spots.fingerprints()
        row_of = {fingerprint: row for row, fingerprint in enumerate(own_spots)}
        row_now = {row: row_of[print_] for row, print_ in enumerate(kept["spots"]) if print_ in row_of}
        self.map.restore(kept["map"])
        self.witnesses.restore(kept["witnesses"])
        self.ground.restore(kept["ground"], row_now)
        boxes = VehicleBoxes(**kept["boxes"])
        self.vehicles.stand(np.union1d(self.vehicles.scene.boxes.group, boxes.group), boxes)
        self.changes.restore(kept["changes"])
        for before, row in row_now.items():
            self._states[row] = SpotState.of_plain(kept["states"][before])
        self.spot_tiles.versions.update({Tile(x, y): version for x, y, version in kept["spot_tiles"]})
        return bool(kept["spots"] == own_spots)

    @property
    def states(self) -> list[SpotState]:
        """State of every spot, in the order of the parking map."""
        return list(self._states)

    @property
    def vehicle_boxes(self) -> VehicleBoxes:
        """Every vehicle on the map, sorted by group."""
        return merge_boxes(self.vehicles.scene.boxes) if self.method.belief else self.vehicles.scene.boxes

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

    def _decide(self, spots: NDArray[np.int64]) -> list[SpotState]:
        if not self.method.belief:
            return decide_two_pass(spots, self.spots, self.vehicles.scene, self.ground, self.method.second_pass)
        evidence = evidence_of(spots, self.spots, self.vehicles.parked, self.ground, self.witnesses, self.method.ground)
        memory, corroboration = self.method.memory, self.method.corroboration
        pairs = zip(spots.tolist(), evidence, strict=True)
        return [believe(self.spots.ids[spot], items, memory, corroboration) for spot, items in pairs]

    def _adopt(self, spots: NDArray[np.int64], states: list[SpotState]) -> NDArray[np.bool_]:
        """Take on new states (T,); returns which spots (T,) they change."""
        pairs = list(zip(spots.tolist(), states, strict=True))
        has_changed = np.array([state != self._states[spot] for spot, state in pairs], np.bool_)
        for spot, state in pairs:
            self._states[spot] = state
        return has_changed

    def _update(self, taken: TakenDiff, spots: NDArray[np.int64], changed: NDArray[np.int64]) -> Update:
        """What everyone is told of a diff that bears on these spots (T,) and changed some (C,)."""
        assert taken.change is not None
        rows = changed.tolist()
        return Update(
            True,
            taken.version,
            tuple(self._states[spot] for spot in rows),
            self._vacant(spots),
            self.changes.append(taken.change),
            taken.diff,
            taken.size,
            taken.change.tiles,
            self.spot_tiles.change(rows, taken.version),
        )

    def _nothing_new(self, taken: TakenDiff) -> Update:
        return Update(False, taken.version, (), [], self.changes.nothing())

    def _vacant(self, spots: NDArray[np.int64]) -> list[dict[str, float]]:
        vacant = [spot for spot in spots.tolist() if self._states[spot].occupancy is Occupancy.VACANT]
        return rectangles_within(self.spots.bounds[vacant])


def _additions_only(diff: SemanticMapDiff) -> SemanticMapDiff:
    return replace(diff, removed=np.zeros(0, np.uint64))
