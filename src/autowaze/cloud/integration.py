"""Semantic map diff -> stored map: new features in, removed features out (thesis, sec. 3.3.1).

The map is a set of features and a set of ids that were reported gone, so the same diffs give the same map in
whatever order and however often they arrive. Features are kept in one block per diff that brought them: an id names
its block, hence integrating a diff costs what the diff touches, however large the map is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.diff_kernels import among
from autowaze.cloud.feature_blocks import block_of, by_block, by_number
from autowaze.cloud.instances import InstanceTable
from autowaze.cloud.map_tiles import MapTiles, OutdatedMapError
from autowaze.cloud.removals import RemovalVotes
from autowaze.cloud.rests import RemovedOfInstances
from autowaze.cloud.vehicle_features import VehicleFeatures
from autowaze.cloud.witnesses import Witnesses
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.identity import SEQUENCE_BITS, instance_keys
from autowaze.world.labels import is_vehicle
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.map_update import MapUpdate
from autowaze.world.tiles import Tile

MAX_WINDOWS = 32
"""Windows whose features of one instance are looked at; a track is lost long before."""

FORGOTTEN_AFTER = 1 << 15
"""Diffs after which an instance without features on the map is forgotten: that car has left, nobody reports of it."""


@dataclass(frozen=True)
class MapChange:
    """What one diff changed in the stored map.

    Attributes:
        added: features that are in the map now and were not.
        removed: (R,) uint64, sorted ids of features that were in the map and are not.
        instances: (K,) uint64, sorted keys of the instances that gained or lost features or were seen again.
        tiles: sorted tiles that gained or lost features.
    """

    added: MapFeatures
    removed: NDArray[np.uint64]
    instances: NDArray[np.uint64]
    tiles: tuple[Tile, ...]


class MapState:
    """The map that the service keeps true.

    Args:
        base_map: what it starts from.
        georeference: of its frame, where the base map names none.
        witnesses: whose word sessions are, for removals that need corroboration; None lets every removal count.
    """

    def __init__(
        self,
        base_map: FeatureMap | None = None,
        georeference: Georeference | None = None,
        witnesses: Witnesses | None = None,
    ) -> None:
        base_map = base_map or FeatureMap()
        self.georeference = base_map.georeference or georeference
        self.instances = InstanceTable()
        self.tiles = MapTiles(self.georeference, base_map.version)
        self._base_version = base_map.version
        self._blocks: dict[int, MapFeatures] = {}
        self._accepted: dict[int, int] = {}
        self._accepted_count = 0
        self._witnesses = witnesses or Witnesses()
        self._votes = RemovalVotes(corroboration=witnesses is not None)
        self._removed_of = RemovedOfInstances()
        self._blocks_of_instance: dict[int, set[int]] = {}
        self._left: deque[tuple[int, int]] = deque()
        for number, block in by_block(base_map.features):
            self._insert(number, block)
            self.tiles.insert(number, block, base_map.version)

    @property
    def version(self) -> int:
        """Version of the base map plus the number of diffs integrated since."""
        return self._base_version + self._accepted_count

    @property
    def base_version(self) -> int:
        """Version of the map that it started from."""
        return self._base_version

    @property
    def features(self) -> MapFeatures:
        """Every feature of the map, sorted by id; costs the whole map."""
        blocks = [self._blocks[number] for number in sorted(self._blocks)]
        return MapFeatures.concatenate(blocks) if blocks else MapFeatures.empty()

    def as_base_map(self) -> FeatureMap:
        """The map for others to start from: it knows no instances, so features of vehicles face as those were seen."""
        features = self.features
        rows = np.flatnonzero(is_vehicle(features.label) & (features.instance_key != 0))
        keys, instance = np.unique(features.instance_key[rows], return_inverse=True)
        view = self.instances.views(keys).view_direction[instance]
        told = view.any(axis=1)
        normal = features.normal.copy()
        normal[rows[told], :2] = -view[told]
        return FeatureMap(replace(features, normal=normal), self.georeference, self.version)

    def knows(self, diff: SemanticMapDiff) -> bool:
        """Whether the diff was integrated already."""
        return bool(self._accepted.get(diff.session, 0) >> diff.sequence & 1)

    def integrate(self, diff: SemanticMapDiff) -> MapChange | None:
        """Take in a checked diff; None if it was integrated before.

        Raises:
            RefusedDiffError: it removes more features that never arrived than can be waited for. Nothing has changed.
        """
        if self.knows(diff):
            return None
        self._votes.require_room(len(diff.removed), self._witnesses.of(diff.session))
        self._accepted[diff.session] = self._accepted.get(diff.session, 0) | 1 << diff.sequence
        self._accepted_count += 1
        added, overtaken = self._add(block_of(diff), diff.new)
        removed = self._remove(diff.removed, self._witnesses.of(diff.session), diff.end)
        gone = removed
        if len(added) and ((removed.id >= added.id[0]) & (removed.id <= added.id[-1])).any():
            added, gone = added[~among(added.id, removed.id)], removed[~among(removed.id, added.id)]
        cells = self.tiles.cells_of(np.concatenate([added.position, gone.position]))
        of_added, of_gone = (None, None) if cells is None else (cells[: len(added)], cells[len(added) :])
        tiles = {*self.tiles.insert(block_of(diff), added, self.version, of_added)}
        tiles.update(self.tiles.remove(gone, self.version, of_gone))
        own = instance_keys(diff.session, diff.instances.id)
        self.instances.add(own, diff)
        touched = np.concatenate([added.instance_key, overtaken.instance_key, removed.instance_key, own])
        touched = np.unique(touched[touched != 0])
        self._forget(touched)
        return MapChange(added, gone.id, touched, tuple(sorted(tiles)))

    def tile_update(self, tile: Tile, since: int | None) -> MapUpdate:
        """What a car lacks of one tile that has it as of a version, or has nothing of it.

        Raises:
            OutdatedMapError: that version is too long ago or yet to come; the tile must be fetched whole.
        """
        if since is not None and since > self.version:
            raise OutdatedMapError(f"map version {since} is yet to come, {self.version} is the newest: fetch it whole")
        gone = np.zeros(0, np.uint64) if since is None else self.tiles.gone_since(tile, since)
        parts = [MapFeatures.empty()]
        for number in self.tiles.blocks_since(tile, since):
            parts.append(self.tiles.inside(tile, self._blocks[number]))
        return MapUpdate(since or 0, self.version, MapFeatures.concatenate(parts), gone, self.georeference)

    @property
    def feature_count(self) -> int:
        """How many features there are."""
        return sum(map(len, self._blocks.values()))

    def blocks_in(self, low: Tile, high: Tile) -> dict[int, MapFeatures]:
        """Blocks, by number, with features in the tiles from one to another; they may reach beyond."""
        numbers: set[int] = set()
        for tile, record in self.tiles.records.items():
            if low.x <= tile.x <= high.x and low.y <= tile.y <= high.y:
                numbers.update(record.blocks)
        return {number: self._blocks[number] for number in sorted(numbers)}

    def positions_of(self, ids: NDArray[np.uint64]) -> NDArray[np.float64]:
        """Positions (R, 3) of those of these features (K,), ids ascending, that are in the map."""
        return np.concatenate([np.zeros((0, 3)), *(block.position[rows] for block, rows in self._rows_of(ids))])

    def labels_of(self, ids: NDArray[np.uint64]) -> NDArray[np.uint8]:
        """Labels (R,) in the same way."""
        return np.concatenate([np.zeros(0, np.uint8), *(block.label[rows] for block, rows in self._rows_of(ids))])

    def _rows_of(self, ids: NDArray[np.uint64]) -> Iterator[tuple[MapFeatures, NDArray[np.bool_]]]:
        """The blocks that hold some of these features (K,), ids ascending, and which rows they are."""
        for number, of_block in by_number(ids):
            block = self._blocks.get(number)
            if block is not None:
                yield block, among(block.id, of_block)

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot."""
        return {
            "accepted": {
                session: bits.to_bytes(1 + bits.bit_length() // 8) for session, bits in self._accepted.items()
            },
            "accepted_count": self._accepted_count,
            "blocks": dict(self._blocks),
            "left": list(self._left),
            "instances": self.instances.kept(),
            "tiles": self.tiles.kept(),
            "votes": self._votes.kept(),
            "removed_of": self._removed_of.kept(),
        }

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""
        self._accepted = {session: int.from_bytes(bits) for session, bits in kept["accepted"].items()}
        self._accepted_count = kept["accepted_count"]
        self._left = deque((count, key) for count, key in kept["left"])
        self._blocks, self._blocks_of_instance = {}, {}
        for number, block in kept["blocks"].items():
            self._insert(number, MapFeatures(**block))
        self.instances.restore(kept["instances"])
        self.tiles.restore(kept["tiles"])
        self._votes.restore(kept["votes"])
        self._removed_of.restore(kept["removed_of"])

    def vehicle_features(self, instances: NDArray[np.uint64]) -> VehicleFeatures:
        """Features with a vehicle's label that belong to these instances, sorted by id.

        Of an instance that gains features over and over, those of the first windows stand for all.
        """
        keys_of_block: dict[int, list[int]] = {}
        for key in instances.tolist():
            for number in sorted(self._blocks_of_instance.get(key, ()))[:MAX_WINDOWS]:
                keys_of_block.setdefault(number, []).append(key)
        parts = [VehicleFeatures.empty()]
        for number, keys in sorted(keys_of_block.items()):
            block = self._blocks[number]
            parts.append(VehicleFeatures.of(block, np.array(keys, np.uint64)))
        return VehicleFeatures.concatenate(parts)

    def has_left(self, instances: NDArray[np.uint64], remaining: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether the vehicles of these instances (K,), of which so many features (K,) remain, are there no more."""
        return self._removed_of.has_left(instances, remaining)

    def _add(self, number: int, features: MapFeatures) -> tuple[MapFeatures, MapFeatures]:
        """Those that are in the map now, and those whose removal came before them."""
        if number in self._blocks:
            return MapFeatures.empty(), MapFeatures.empty()
        is_gone = self._votes.condemned(number, features, self._owner(number))
        features, overtaken = features[~is_gone], features[is_gone]
        self._votes.settle(number, features.id)
        self._insert(number, features)
        self._removed_of.note(overtaken)
        return features, overtaken

    def _insert(self, number: int, features: MapFeatures) -> None:
        self._blocks[number] = features
        for key in np.unique(features.instance_key[is_vehicle(features.label)]).tolist():
            if key:
                self._blocks_of_instance.setdefault(key, set()).add(number)

    def _remove(self, ids: NDArray[np.uint64], source: int, end: float) -> MapFeatures:
        gone = []
        for number, of_block in by_number(ids):
            block = self._blocks.get(number)
            if block is None and self._arrived(number):
                continue
            self._votes.add(number, of_block, source, end)
            if block is not None:
                is_gone = self._votes.condemned(number, block, self._owner(number))
                gone.append(block[is_gone])
                self._keep(number, block[~is_gone], gone[-1])
                self._votes.settle(number, block.id[~is_gone])
        return MapFeatures.concatenate(gone) if gone else MapFeatures.empty()

    def _keep(self, number: int, left: MapFeatures, gone: MapFeatures) -> None:
        """Put what is left of a block in its place; of one of which nothing is left only its arrival is remembered."""
        self._blocks[number] = left
        self._removed_of.note(gone)
        standing = left.instance_key[is_vehicle(left.label)]
        for key in sorted(set(gone.instance_key.tolist()).difference(standing.tolist())):
            numbers = self._blocks_of_instance.get(key, set())
            numbers.discard(number)
            if not numbers:
                self._blocks_of_instance.pop(key, None)
        if len(left) == 0 and self._arrived(number):
            del self._blocks[number]
            self.tiles.forget(number)

    def _forget(self, touched: NDArray[np.uint64]) -> None:
        """Drop what is known of instances that have had no features on the map for a while: those cars have left."""
        count = self._accepted_count
        self._left.extend((count, key) for key in touched.tolist() if key not in self._blocks_of_instance)
        while self._left and self._left[0][0] + FORGOTTEN_AFTER < count:
            key = self._left.popleft()[1]
            if key not in self._blocks_of_instance:
                self.instances.forget(key)
                self._removed_of.forget(key)

    def _owner(self, number: int) -> int:
        """Whose word the features of a block are."""
        return self._witnesses.of(number >> SEQUENCE_BITS)

    def _arrived(self, number: int) -> bool:
        session, sequence = number >> SEQUENCE_BITS, number & ((1 << SEQUENCE_BITS) - 1)
        return bool(self._accepted.get(session, 0) >> sequence & 1)
