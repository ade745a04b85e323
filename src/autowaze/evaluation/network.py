"""What a drive costs on the network, up and down (thesis, sec. 4.5)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import zstandard
from numpy.typing import NDArray

from autowaze.cloud.broadcast import Update
from autowaze.cloud.service import CloudService
from autowaze.evaluation.drive import DriveRecord
from autowaze.vehicle.tile_follower import FETCHED_AROUND_M, MOST_TILES
from autowaze.world import wire_pb2 as pb
from autowaze.world.tiles import Tile, tiles_around
from autowaze.world.wire import body_of, encode_map_update

THESIS_FIGURES = {"diff_bytes_min": 1_000.0, "diff_bytes_max": 60_000.0}
"""Of a window of 5 s at 10 frames a second (sec. 4.5), to be shown beside ours."""

_CONTENT = {
    "new": "features",
    "removed": "removals",
    "removed_count": "removals",
    "instances": "instances",
    "ground": "ground",
    "trajectory": "trajectory",
}
_REST = "rest"
CONTENTS = (*dict.fromkeys(_CONTENT.values()), _REST)
_ZSTD_LEVEL = 12  # as diffs are packed


def network_metrics(record: DriveRecord) -> dict[str, float]:
    """Bytes per diff and per kilometre, and what the diffs held."""
    sizes = [len(message) for message in record.messages]
    if not sizes:
        return {"diffs": 0.0}
    return {
        "diffs": float(len(sizes)),
        "diff_bytes_min": float(min(sizes)),
        "diff_bytes_median": float(np.median(sizes)),
        "diff_bytes_p95": float(np.percentile(sizes, 95)),
        "diff_bytes_max": float(max(sizes)),
        "bytes_per_km": _per_km(sum(sizes), record),
        "new_features": float(sum(len(diff.new) for diff in record.diffs)),
        "removed_features": float(sum(len(diff.removed) for diff in record.diffs)),
    }


def content_metrics(record: DriveRecord) -> dict[str, float]:
    """Bytes up by content: per diff, and per kilometre; the contents add up to the whole."""
    if not record.messages:
        return {}
    bytes_of = np.array([list(content_bytes(message).values()) for message in record.messages])
    out = {f"{name}_bytes_per_diff": float(mean) for name, mean in zip(CONTENTS, bytes_of.mean(axis=0), strict=True)}
    totals = zip(CONTENTS, bytes_of.sum(axis=0), strict=True)
    return out | {f"{name}_bytes_per_km": _per_km(total, record) for name, total in totals}


def content_bytes(message: bytes) -> dict[str, float]:
    """Bytes of one encoded diff by content.

    One zstd frame holds them all, so each content is packed by itself and its size scaled, such that all of them add
    up to the message. The rest is the header, moving objects and what encloses the message.
    """
    body = body_of(message)
    parts = dict.fromkeys(CONTENTS, b"")
    diff = pb.SemanticMapDiff.FromString(body)
    for descriptor, _ in diff.ListFields():
        alone = pb.SemanticMapDiff.FromString(body)
        for other, _ in diff.ListFields():
            if other.name != descriptor.name:
                alone.ClearField(other.name)  # type: ignore[arg-type]  # a name known only here
        parts[_CONTENT.get(descriptor.name, _REST)] += alone.SerializeToString(deterministic=True)
    packer = zstandard.ZstdCompressor(level=_ZSTD_LEVEL, write_content_size=False)
    empty = len(packer.compress(b""))
    packed = {name: max(len(packer.compress(part)) - empty, 0) for name, part in parts.items()}
    scale = len(message) / max(sum(packed.values()), 1)
    return {name: scale * size for name, size in packed.items()}


@dataclass
class TileFetches:
    """What a car that follows the map would fetch from the service after each of its windows.

    As `vehicle.tile_follower` does: of each tile around the car all that it holds the first time, then what came and
    went since. The car's own finds are among it.

    Attributes:
        first_bytes: of tiles fetched whole.
        update_bytes: per window, of what changed in tiles that the car has.
        spot_bytes: per window, of the spots that changed, as JSON rectangles of the vacant ones.
    """

    cloud: CloudService
    first_bytes: int = 0
    update_bytes: list[int] = field(default_factory=list)
    spot_bytes: list[int] = field(default_factory=list)
    _versions: dict[Tile, int] = field(default_factory=dict)

    def begin(self, position_map: NDArray[np.floating]) -> None:
        """Fetch the tiles around where the drive begins."""
        self._fetch(self._around(position_map))

    def receive(self, message: bytes) -> Update:
        """Pass a diff on to the service, then fetch what changed around the end of its path."""
        update = self.cloud.receive(message)
        path = update.diff.trajectory.position if update.diff is not None else np.zeros((0, 3))
        self.update_bytes.append(self._fetch(self._around(path[-1])) if len(path) else 0)
        self.spot_bytes.append(len(update.vacant_json))
        return update

    def metrics(self, record: DriveRecord) -> dict[str, float]:
        """Flat names for reports."""
        if not self.update_bytes:
            return {}
        down = [of_map + of_spots for of_map, of_spots in zip(self.update_bytes, self.spot_bytes, strict=True)]
        return {
            "down_first_bytes": float(self.first_bytes),
            "down_bytes_median": float(np.median(down)),
            "down_bytes_p95": float(np.percentile(down, 95)),
            "down_bytes_per_km": _per_km(sum(down), record),
            "down_map_bytes_per_diff": float(np.mean(self.update_bytes)),
            "down_spots_bytes_per_diff": float(np.mean(self.spot_bytes)),
        }

    def _around(self, position_map: NDArray[np.floating]) -> list[Tile]:
        georeference = self.cloud.map.georeference
        return tiles_around(position_map, FETCHED_AROUND_M, georeference, MOST_TILES) if georeference else []

    def _fetch(self, tiles: Iterable[Tile]) -> int:
        """Bytes of what changed; tiles that are new to the car count towards `first_bytes`."""
        changed = 0
        for tile in tiles:
            since, version = self._versions.get(tile), self.cloud.map.tiles.version(tile)
            if tile not in self.cloud.map.tiles.records or since == version:
                continue
            size = len(encode_map_update(self.cloud.map.tile_update(tile, since)))
            self._versions[tile] = version
            if since is None:
                self.first_bytes += size
            else:
                changed += size
        return changed


def _per_km(size: float, record: DriveRecord) -> float:
    return 1000.0 * float(size) / max(record.distance_m, 1.0)
