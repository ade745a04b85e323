"""Boxes of one vehicle that was seen under several ids, or by several cars, become one.

Boxes are compared, not points: neighbours in bays stand so close that their points would fuse.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.box_overlap import leaders_and_clusters
from autowaze.world.vehicles import VehicleBoxes

SAME_VEHICLE_IOU = 0.3
ENOUGH_TO_SAY_WHERE = 0.25
"""Share of a vehicle's points."""
ONE_LOOK_S = 30.0
"""Boxes seen last within this time of each other are of one look at a vehicle."""


class MergedVehicles(NamedTuple):
    """Vehicles, and the boxes that each was merged from.

    Attributes:
        vehicles: V rows, sorted by group.
        parts: P rows, the boxes as they were.
        whole: (P,) int64, row in `vehicles` of each part.
        cluster: (P,) int64, the first part of those that each hangs together with.
    """

    vehicles: VehicleBoxes
    parts: VehicleBoxes
    whole: NDArray[np.int64]
    cluster: NDArray[np.int64]


def merge_boxes(boxes: VehicleBoxes) -> VehicleBoxes:
    """Each box with most points takes in those that overlap it enough (intersection over union)."""
    return merge_parts(boxes).vehicles


def merge_parts(boxes: VehicleBoxes) -> MergedVehicles:
    """As `merge_boxes`, with what was merged into what."""
    if len(boxes) < 2:
        return MergedVehicles(boxes, boxes, np.arange(len(boxes)), np.arange(len(boxes)))
    order = np.lexsort((boxes.centre[:, 1], boxes.centre[:, 0], boxes.group, -boxes.points))
    boxes = boxes[order]
    leader, cluster = leaders_and_clusters(boxes.corners, SAME_VEHICLE_IOU)
    first = np.flatnonzero(leader == np.arange(len(boxes)))
    whole = np.searchsorted(first, leader)
    result = boxes[first]
    members = np.argsort(whole, kind="stable")
    ends = np.cumsum(np.bincount(whole, minlength=len(first)))
    for row in np.flatnonzero(np.diff(ends, prepend=0) > 1).tolist():
        _take_in(result, row, boxes[members[ends[row - 1] if row else 0 : ends[row]]])
    by_group = np.argsort(result.group, kind="stable")
    return MergedVehicles(result[by_group], boxes, np.argsort(by_group)[whole], cluster)


def _take_in(result: VehicleBoxes, row: int, members: VehicleBoxes) -> None:
    """One box keeps its size and heading as the one with most points, and moves to the mean place by points.

    The newest look says where, if it saw enough: what is left of older ones may be of a vehicle that stood here before.
    """
    weight = members.points / members.points.sum()
    newest = weight * (members.seen_at >= members.seen_at.max() - ONE_LOOK_S)
    where = newest / newest.sum() if newest.sum() >= ENOUGH_TO_SAY_WHERE else weight
    result.centre[row] = where @ members.centre
    result.group[row] = members.group.min()
    result.confidence[row] = weight @ members.confidence
    result.points[row] = members.points.sum()
    result.seen_at[row] = members.seen_at.max()
