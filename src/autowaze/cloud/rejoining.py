"""Parts of one instance that lie on one vehicle become one group again.

Ids are split in space because a track may jump to the next vehicle. What the gap cuts off of the same vehicle, as the
far end of a side of which the middle shows no features, lies on the box that the larger part foretells; the next
vehicle does not.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.grouping import VehicleGroups
from autowaze.cloud.visible_side import MIN_POINTS
from autowaze.world.vehicles import VehicleBoxes

RIM_M = 0.3
"""How far beyond a box, whose length is that of its class, points of the same vehicle lie."""


def rejoin_parts(groups: VehicleGroups, boxes: VehicleBoxes) -> VehicleGroups:
    """The groups, each part of an instance most of which lies on the box of a larger part joined to that.

    Args:
        groups: G rows, parts of one instance next to each other.
        boxes: of those of them that have `MIN_POINTS`, in their order; see `visible_side`.
    """
    keys, sizes = groups.views.key, groups.sizes
    if not (keys[1:] == keys[:-1]).any():
        return groups
    box_of = np.where(sizes >= MIN_POINTS, np.cumsum(sizes >= MIN_POINTS) - 1, -1)
    sides = np.stack([np.sin(boxes.heading), np.cos(boxes.heading)], axis=1)
    half = np.stack([boxes.length, boxes.width], axis=1) / 2 + RIM_M
    whole = _wholes(
        keys, box_of, groups.starts, np.ascontiguousarray(groups.position[:, :2]), boxes.centre, sides, half
    )
    if (whole == np.arange(len(whole))).all():
        return groups
    kept, row = np.unique(whole, return_inverse=True)
    owner = row[groups.group]
    order = np.argsort(owner, kind="stable")
    return VehicleGroups(groups.position[order], owner[order], groups.views[kept])


@numba.njit(cache=True, nogil=True)
def _wholes(
    keys: NDArray[np.uint64],
    box_of: NDArray[np.int64],
    starts: NDArray[np.int64],
    points: NDArray[np.float64],
    centre: NDArray[np.float64],
    sides: NDArray[np.float64],
    half: NDArray[np.float64],
) -> NDArray[np.int64]:
    """The group (G,) that each is part of, itself where it is none.

    Args:
        keys: (G,), equal ones together. box_of: (G,) row of the group's box, -1 for none.
        starts: (G + 1,) bounds of the group's points. points: (P, 2).
        centre, sides, half: (B, 2) of boxes: middles; unit vectors along; half lengths and widths with the rim.
    """
    whole = np.arange(len(keys))
    first = 0
    while first < len(keys):
        end = first + 1
        while end < len(keys) and keys[end] == keys[first]:
            end += 1
        by_size = first + np.argsort(starts[first:end] - starts[first + 1 : end + 1], kind="mergesort")
        for rank in range(1, end - first):
            part = by_size[rank]
            for larger in by_size[:rank]:
                box = box_of[larger]
                if box < 0 or whole[larger] != larger:
                    continue
                inside = 0
                for p in range(starts[part], starts[part + 1]):
                    x, y = points[p, 0] - centre[box, 0], points[p, 1] - centre[box, 1]
                    along = abs(x * sides[box, 0] + y * sides[box, 1])
                    across = abs(x * sides[box, 1] - y * sides[box, 0])
                    inside += along <= half[box, 0] and across <= half[box, 1]
                if 2 * inside > starts[part + 1] - starts[part]:
                    whole[part] = larger
                    break
        first = end
    return whole
