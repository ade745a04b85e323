"""Diffs of different places are settled together, at a fraction of what each costs by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.broadcast import Update
from autowaze.cloud.diff_kernels import extent_of_cells, extent_of_places
from autowaze.cloud.service import CloudService
from autowaze.cloud.taken_diffs import TakenDiff
from autowaze.world.ground import CELL_M
from autowaze.world.map_diff import SemanticMapDiff

VEHICLE_REACH_M = 15.0
"""From a point of a vehicle to its farthest corner, or to that of a spot that it stands in."""
SIGHT_M = 50.0
"""Vehicles of which a window tells nothing but that they are still there stand so near to the car."""


class Settlement:
    """Takes diffs into a service one after the other, and has it settle several at once.

    Those that may bear on the same spots are not settled together: every update is the one that there would be had
    each diff been settled before the next was taken, so what is made of updates does not depend on how busy it was.

    Args:
        service: nobody else may use it until `settle`.
    """

    def __init__(self, service: CloudService) -> None:
        self._service = service
        self._taken: list[TakenDiff] = []
        self._reaches: list[NDArray[np.float64]] = []
        self._updates: list[Update] = []

    def take(self, diff: SemanticMapDiff, size: int = 0, source: int | None = None) -> TakenDiff:
        """Take a diff; those before it may have to be settled first.

        Raises:
            WireError: as `CloudService.integrate`; nothing has changed.
        """
        reach = self._reach(diff)
        if self._meets(reach):
            self._settle()
        taken = self._service.take(diff, size, source)
        self._taken.append(taken)
        self._reaches.append(reach)
        return taken

    def settle(self) -> list[Update]:
        """The updates of the diffs taken since the last time, in order."""
        self._settle()
        updates, self._updates = self._updates, []
        return updates

    def _settle(self) -> None:
        if self._taken:
            self._updates += self._service.settle(self._taken)
            self._taken, self._reaches = [], []

    def _meets(self, reach: NDArray[np.float64]) -> bool:
        if not self._service.method.instance_ids:
            return len(self._taken) > 0  # without instances each diff may turn every group
        others = np.array(self._reaches).reshape(-1, 4)
        return bool(((others[:, :2] <= reach[2:]) & (reach[:2] <= others[:, 2:])).all(axis=1).any())

    def _reach(self, diff: SemanticMapDiff) -> NDArray[np.float64]:
        """Bounds (4,) x0, y0, x1, y1 in map metres of all that a diff may bear on."""
        removed = self._service.map.positions_of(diff.removed)
        told = _grown(extent_of_places(diff.new.position, removed), VEHICLE_REACH_M)
        path = _grown(extent_of_places(diff.trajectory.position, diff.trajectory.position), SIGHT_M)
        bounds = [told, path]
        if len(diff.ground):
            x0, x1, y0, y1, _ = extent_of_cells(diff.ground.ix, diff.ground.iy)
            bounds.append(_grown((x0 * CELL_M, x1 * CELL_M, y0 * CELL_M, y1 * CELL_M), VEHICLE_REACH_M))
        low_high = np.array(bounds)
        return np.concatenate([low_high[:, :2].min(axis=0), low_high[:, 2:].max(axis=0)])


def _grown(extent: tuple[float, float, float, float], by_m: float) -> tuple[float, float, float, float]:
    """Bounds x0, y0, x1, y1 of an extent x0, x1, y0, y1 with a margin."""
    x0, x1, y0, y1 = extent
    return x0 - by_m, y0 - by_m, x1 + by_m, y1 + by_m
