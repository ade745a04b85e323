"""The vehicles that stand on the map now, found by group and by place."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.vehicles import VehicleBoxes

_CELL_M = 32.0
"""A box is filed under the grid cell of its centre."""
_LONGEST_BOX_M = 20.0


class VehicleScene:
    """Boxes by the group that they came from; a group may have several."""

    def __init__(self) -> None:
        self._boxes: dict[int, VehicleBoxes] = {}
        self._cells: dict[tuple[int, int], set[int]] = {}

    def __len__(self) -> int:
        return sum(len(boxes) for boxes in self._boxes.values())

    @property
    def boxes(self) -> VehicleBoxes:
        """All boxes, sorted by group."""
        return self._of(self._boxes)

    def of(self, groups: NDArray[np.uint64]) -> VehicleBoxes:
        """Boxes of these groups (K,), sorted by group."""
        return self._of(group for group in groups.tolist() if group in self._boxes)

    def replace(self, groups: NDArray[np.uint64], boxes: VehicleBoxes) -> None:
        """Forget the boxes of these groups (K,) and put these in their place."""
        for group in groups.tolist():
            self._forget(group)
        if len(boxes) == 0:
            return
        boxes = boxes[np.argsort(boxes.group, kind="stable")]
        ends = np.append(np.flatnonzero(boxes.group[1:] != boxes.group[:-1]) + 1, len(boxes)).tolist()
        for first, end in pairwise([0, *ends]):
            own = boxes[first:end]
            group = int(own.group[0])
            self._boxes[group] = own
            for cell in _cells_of(own):
                self._cells.setdefault(cell, set()).add(group)

    def near(self, bounds: NDArray[np.float64]) -> VehicleBoxes:
        """Boxes that may touch rectangles (M, 4) of x0, y0, x1, y1 in metres, sorted by group."""
        low = np.floor((bounds[:, :2] - _LONGEST_BOX_M) / _CELL_M).astype(np.int64)
        high = np.floor((bounds[:, 2:] + _LONGEST_BOX_M) / _CELL_M).astype(np.int64)
        corners = np.unique(np.hstack([low, high]), axis=0).tolist()
        cells = {(i, j) for i0, j0, i1, j1 in corners for i in range(i0, i1 + 1) for j in range(j0, j1 + 1)}
        return self._of({group for cell in cells for group in self._cells.get(cell, ())})

    def overlapping(self, polygons: NDArray[np.object_]) -> VehicleBoxes:
        """Boxes that meet any of the polygons (M,), sorted by group."""
        if len(polygons) == 0:
            return VehicleBoxes.empty()
        boxes = self.near(shapely.bounds(polygons))
        rows = shapely.STRtree(polygons).query(boxes.polygons, predicate="intersects")[0]
        return boxes[np.unique(rows)]

    def _forget(self, group: int) -> None:
        boxes = self._boxes.pop(group, None)
        for cell in _cells_of(boxes) if boxes is not None else ():
            self._cells[cell].discard(group)
            if not self._cells[cell]:
                del self._cells[cell]

    def _of(self, groups: Iterable[int]) -> VehicleBoxes:
        parts = [self._boxes[group] for group in sorted(groups)]
        return VehicleBoxes.concatenate(parts) if parts else VehicleBoxes.empty()


def _cells_of(boxes: VehicleBoxes) -> set[tuple[int, int]]:
    return {(i, j) for i, j in np.floor(boxes.centre / _CELL_M).astype(np.int64).tolist()}
