"""Diffs that the map has taken in and that vehicles and spots are yet to follow, several at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.integration import MapChange
from autowaze.world.map_diff import SemanticMapDiff

NO_SPOTS, _NO_KEYS = np.zeros(0, np.int64), np.zeros(0, np.uint64)


@dataclass(frozen=True)
class TakenDiff:
    """One diff.

    Attributes:
        diff: decoded.
        size: bytes that it came as, 0 if it came as none.
        version: of the map with it.
        change: what it changed in the map; None if the map had it before.
        looked_at: (T,) int64, ascending: spots of which it saw the ground.
    """

    diff: SemanticMapDiff
    size: int
    version: int
    change: MapChange | None
    looked_at: NDArray[np.int64]


@dataclass(frozen=True)
class Tidings:
    """What some diffs that were taken in one after the other may bear on.

    Attributes:
        taken: those that changed the map, in this order.
        instances: (K,) uint64, ascending keys of the instances that any of them touched.
    """

    taken: tuple[TakenDiff, ...]
    instances: NDArray[np.uint64]

    @classmethod
    def of(cls, taken: Sequence[TakenDiff]) -> Tidings:
        """All that is new."""
        new = tuple(one for one in taken if one.change is not None)
        touched = [one.change.instances for one in new if one.change is not None]
        return cls(new, touched[0] if len(touched) == 1 else np.unique(np.concatenate([_NO_KEYS, *touched])))

    def bearers(
        self, keys: NDArray[np.uint64], stood_on: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Spots (T,) that may have changed, ascending, and the row (T,) in `taken` of the last diff that says so.

        Args:
            keys: (M,) of the instances of boxes that came or went.
            stood_on: (M,) spots that these touch.
        """
        if len(self.taken) == 1:
            spots = np.union1d(self.taken[0].looked_at, stood_on)
            return spots, np.zeros(len(spots), np.int64)
        last_of_key: dict[int, int] = {}
        last_of_spot: dict[int, int] = {}
        for row, one in enumerate(self.taken):
            assert one.change is not None
            last_of_key.update(dict.fromkeys(one.change.instances.tolist(), row))
            last_of_spot.update(dict.fromkeys(one.looked_at.tolist(), row))
        newest = len(self.taken) - 1
        for key, spot in zip(keys.tolist(), stood_on.tolist(), strict=True):
            # A method without instances groups all points anew with every diff: then the last one speaks.
            last_of_spot[spot] = max(last_of_spot.get(spot, 0), last_of_key.get(key, newest))
        spots = np.array(sorted(last_of_spot), np.int64)
        return spots, np.array([last_of_spot[spot] for spot in spots.tolist()], np.int64)
