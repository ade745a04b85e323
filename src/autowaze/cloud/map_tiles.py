"""The map by place: which blocks of features lie in a tile, when it last changed, and what has gone from it.

A car fetches the tiles around it and comes back with the version that it has; whatever the size of the city and
however long it was away, it gets the features that came since and the ids of those that went.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import MapFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.tiles import Tile, tiles_of_map

MOST_GONE = 1 << 14
"""Ids of removed features kept per tile, 128 KiB; a car that missed more fetches the tile whole."""


class OutdatedMapError(AutowazeError):
    """A car's map is too old to be brought up to date by changes; it must fetch it again."""


@dataclass
class TileRecord:
    """What is known of one tile.

    Attributes:
        version: of the map when features of the tile came or went last.
        complete_since: the oldest version of which all that went since is known.
        blocks: numbers of the blocks with features in the tile, and the version that each came with.
        gone: version and ids (R,) uint64 of what went, oldest first.
        gone_count: ids in `gone`.
    """

    version: int
    complete_since: int
    blocks: dict[int, int] = field(default_factory=dict)
    gone: list[tuple[int, NDArray[np.uint64]]] = field(default_factory=list)
    gone_count: int = 0


class MapTiles:
    """Tiles of one map; a map that floats freely has none."""

    def __init__(self, georeference: Georeference | None, version: int) -> None:
        self._georeference = georeference
        self._first_version = version
        self._tiles_of_block: dict[int, tuple[Tile, ...]] = {}
        self.records: dict[Tile, TileRecord] = {}

    def insert(
        self, number: int, features: MapFeatures, version: int, cells: NDArray[np.int64] | None = None
    ) -> tuple[Tile, ...]:
        """Note a block that came with a version; returns its tiles, sorted. Cells (N, 2) are `cells_of` them."""
        tiles = tuple(tile for tile, _ in self._parts(features, cells))
        self._tiles_of_block[number] = tiles
        for tile in tiles:
            record = self._changed(tile, version)
            record.blocks[number] = version
        return tiles

    def remove(self, features: MapFeatures, version: int, cells: NDArray[np.int64] | None = None) -> tuple[Tile, ...]:
        """Note features that went with a version; returns their tiles, sorted. Cells (N, 2) are `cells_of` them."""
        parts = self._parts(features, cells)
        for tile, rows in parts:
            record = self._changed(tile, version)
            gone = features.id[rows]
            record.gone.append((version, gone))
            record.gone_count += len(gone)
            _bound(record)
        return tuple(tile for tile, _ in parts)

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot."""
        return {
            "tiles": [
                (tile.x, tile.y, record.version, record.complete_since, dict(record.blocks), list(record.gone))
                for tile, record in self.records.items()
            ]
        }

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""
        self.records, tiles_of_block = {}, defaultdict(list)
        for x, y, version, complete_since, blocks, gone in kept["tiles"]:
            removals = [(when, ids) for when, ids in gone]
            count = sum(len(ids) for _, ids in removals)
            self.records[Tile(x, y)] = TileRecord(version, complete_since, blocks, removals, count)
            for number in blocks:
                tiles_of_block[number].append(Tile(x, y))
        self._tiles_of_block = {number: tuple(sorted(tiles)) for number, tiles in tiles_of_block.items()}

    def forget(self, number: int) -> None:
        """Drop a block of which nothing is left."""
        for tile in self._tiles_of_block.pop(number, ()):
            del self.records[tile].blocks[number]

    def version(self, tile: Tile) -> int:
        """Version of the map when the tile changed last."""
        record = self.records.get(tile)
        return self._first_version if record is None else record.version

    def blocks_since(self, tile: Tile, since: int | None) -> list[int]:
        """Numbers of the blocks that came after a version, or of all."""
        record = self.records.get(tile)
        if record is None:
            return []
        return sorted(number for number, version in record.blocks.items() if since is None or version > since)

    def gone_since(self, tile: Tile, since: int) -> NDArray[np.uint64]:
        """Sorted ids (R,) of the features that went after a version.

        Raises:
            OutdatedMapError: that is too long ago; the tile must be fetched whole.
        """
        record = self.records.get(tile)
        if since < (self._first_version if record is None else record.complete_since):
            raise OutdatedMapError(f"tile {tile.x}/{tile.y}: version {since} is too long ago: fetch the tile whole")
        parts = [ids for version, ids in record.gone if version > since] if record else []
        return np.sort(np.concatenate([np.zeros(0, np.uint64), *parts]))

    def inside(self, tile: Tile, features: MapFeatures) -> MapFeatures:
        """Those of the features that lie in a tile."""
        if self._georeference is None:
            return features[:0]
        return features[(tiles_of_map(features.position, self._georeference) == tile).all(axis=1)]

    def cells_of(self, position: NDArray[np.float64]) -> NDArray[np.int64] | None:
        """Tiles x, y (N, 2) of positions (N, 3); one call for many costs hardly more than for a few."""
        return None if self._georeference is None else tiles_of_map(position, self._georeference)

    def _parts(
        self, features: MapFeatures, cells: NDArray[np.int64] | None
    ) -> list[tuple[Tile, NDArray[np.int64] | slice]]:
        """The tiles that features lie in, sorted, and the rows of each; none where the map floats freely."""
        if self._georeference is None or len(features) == 0:
            return []
        if cells is None:
            cells = tiles_of_map(features.position, self._georeference)
        if (cells == cells[0]).all():
            return [(Tile(*cells[0].tolist()), slice(None))]
        tiles, part = np.unique(cells, axis=0, return_inverse=True)
        return [(Tile(*tile), np.flatnonzero(part == number)) for number, tile in enumerate(tiles.tolist())]

    def _changed(self, tile: Tile, version: int) -> TileRecord:
        record = self.records.get(tile)
        if record is None:
            record = self.records[tile] = TileRecord(version, self._first_version)
        record.version = version
        return record


class SpotTiles:
    """When spots of each tile last changed."""

    def __init__(self, centres: NDArray[np.float64], georeference: Georeference, version: int) -> None:
        self._georeference = georeference
        self.tiles = [Tile(x, y) for x, y in tiles_of_map(centres, georeference).tolist()]
        self.versions = dict.fromkeys(self.tiles, version)

    def draw(self, spot: int, centre: NDArray[np.float64], version: int) -> None:
        """Note that a spot was drawn, at the end or in the place of one that was, with its centre (2,)."""
        x, y = tiles_of_map(centre[None], self._georeference)[0].tolist()
        self.change([spot] if spot < len(self.tiles) else [], version)
        self.tiles[spot : spot + 1] = [Tile(x, y)]
        self.change([spot], version)

    def erase(self, spot: int, version: int) -> None:
        """Note that a spot was erased; later ones move up by one."""
        self.change([spot], version)
        del self.tiles[spot]

    def change(self, spots: Iterable[int], version: int) -> tuple[Tile, ...]:
        """Note that these spots changed; returns their tiles, sorted."""
        tiles = tuple(sorted({self.tiles[spot] for spot in spots}))
        self.versions.update(dict.fromkeys(tiles, version))
        return tiles


def _bound(record: TileRecord) -> None:
    if record.gone_count <= MOST_GONE:
        return
    half = len(record.gone) // 2 or 1
    record.complete_since = record.gone[half - 1][0]
    del record.gone[:half]
    record.gone_count = sum(len(ids) for _, ids in record.gone)
