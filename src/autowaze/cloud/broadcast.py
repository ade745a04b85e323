"""What goes back to every car after a diff (thesis, sec. 3.3.6)."""

from __future__ import annotations

import json
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from autowaze.cloud.integration import MapChange
from autowaze.cloud.map_tiles import OutdatedMapError
from autowaze.world.feature_map import MapFeatures
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.map_update import MapUpdate
from autowaze.world.parking import SpotState
from autowaze.world.tiles import Tile

__all__ = ["ChangeLog", "OutdatedMapError", "Update"]

KEPT_CHANGES = 1024
"""Map versions that a car may lag behind before it must fetch the whole map."""


@dataclass(frozen=True)
class Update:
    """What one diff changed.

    Attributes:
        accepted: False for a diff that had been integrated before; nothing changed then.
        version: of the map now.
        spots: new states of the spots whose state changed.
        vacant: rectangles {x, y, width, height} in map metres of the vacant spots among those the diff bears on.
        map: the map update from the version before.
        diff: the diff itself, if it was accepted now.
        diff_bytes: its size as it came, 0 if it came as no bytes.
        map_tiles, spot_tiles: sorted tiles of which features came or went, and of which spots changed.
    """

    accepted: bool
    version: int
    spots: tuple[SpotState, ...]
    vacant: list[dict[str, float]]
    map: MapUpdate
    diff: SemanticMapDiff | None = None
    diff_bytes: int = 0
    map_tiles: tuple[Tile, ...] = ()
    spot_tiles: tuple[Tile, ...] = ()

    @property
    def vacant_json(self) -> str:
        """The thesis's output: a JSON array of rectangles."""
        return json.dumps(self.vacant, separators=(",", ":"))


class ChangeLog:
    """The newest changes of the map, one per version."""

    def __init__(self, version: int) -> None:
        self.version = version
        self._changes: deque[MapChange] = deque(maxlen=KEPT_CHANGES)

    def append(self, change: MapChange) -> MapUpdate:
        """Note a change that made the next version."""
        self._changes.append(change)
        self.version += 1
        return MapUpdate(self.version - 1, self.version, change.added, change.removed)

    def nothing(self) -> MapUpdate:
        """The update of a map that is up to date."""
        return MapUpdate(self.version, self.version, MapFeatures.empty(), np.zeros(0, np.uint64))

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot."""
        changes = [(change.added, change.removed, change.instances, change.tiles) for change in self._changes]
        return {"version": self.version, "changes": changes}

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""
        self.version = kept["version"]
        self._changes.clear()
        for added, removed, instances, tiles in kept["changes"]:
            self._changes.append(MapChange(MapFeatures(**added), removed, instances, tuple(Tile(*t) for t in tiles)))

    def since(self, version: int) -> MapUpdate:
        """All changes after a version as one.

        Raises:
            OutdatedMapError: the version is unknown or too old.
        """
        behind = self.version - version
        if not 0 <= behind <= len(self._changes):
            raise OutdatedMapError(f"no changes kept from map version {version} to {self.version}: fetch the whole map")
        if behind == 0:
            return self.nothing()
        changes = list(self._changes)[-behind:]
        added = MapFeatures.concatenate([change.added for change in changes])
        removed = np.concatenate([change.removed for change in changes])
        lasting = ~np.isin(added.id, removed)
        return MapUpdate(version, self.version, added[lasting], np.setdiff1d(removed, added.id))
