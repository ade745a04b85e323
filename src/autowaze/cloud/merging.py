"""Boxes of one vehicle that was seen under several ids, or by several cars, become one.

Boxes are compared, not points: neighbours in bays stand so close that their points would fuse.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.cloud.scene import VehicleScene
from autowaze.world.vehicles import VehicleBoxes

SAME_VEHICLE_IOU = 0.3


class MergedVehicles(NamedTuple):
    """Vehicles, and the boxes that each was merged from.

    Attributes:
        vehicles: V rows, sorted by group.
        parts: P rows, the boxes as they were.
        whole: (P,) int64, row in `vehicles` of each part.
    """

    vehicles: VehicleBoxes
    parts: VehicleBoxes
    whole: NDArray[np.int64]


def vehicles_at(polygons: NDArray[np.object_], scene: VehicleScene) -> MergedVehicles:
    """The merged vehicles around these polygons (M,), sorted by group.

    What a box merges with may reach beyond the polygons, so all boxes are taken that hang together with theirs.
    """
    boxes = scene.overlapping(polygons)
    while True:
        linked = scene.overlapping(boxes.polygons)
        if len(linked) == len(boxes):
            return merge_parts(boxes)
        boxes = linked


def merge_boxes(boxes: VehicleBoxes) -> VehicleBoxes:
    """Each box with most points takes in those that overlap it enough (intersection over union)."""
    return merge_parts(boxes).vehicles


def merge_parts(boxes: VehicleBoxes) -> MergedVehicles:
    """As `merge_boxes`, with what was merged into what."""
    if len(boxes) < 2:
        return MergedVehicles(boxes, boxes, np.arange(len(boxes)))
    order = np.lexsort((boxes.centre[:, 1], boxes.centre[:, 0], boxes.group, -boxes.points))
    boxes = boxes[order]
    similar = _iou(boxes) >= SAME_VEHICLE_IOU
    free = np.ones(len(boxes), np.bool_)
    merged: list[VehicleBoxes] = []
    whole = np.zeros(len(boxes), np.int64)
    for row in range(len(boxes)):
        if free[row]:
            members = np.flatnonzero(similar[row] & free)
            free[members] = False
            whole[members] = len(merged)
            merged.append(_merged(boxes[members]))
    result = VehicleBoxes.concatenate(merged)
    by_group = np.argsort(result.group, kind="stable")
    return MergedVehicles(result[by_group], boxes, np.argsort(by_group)[whole])


def _iou(boxes: VehicleBoxes) -> NDArray[np.float64]:
    """Intersection over union (N, N) of all pairs; 1 on the diagonal."""
    polygons = boxes.polygons
    a, b = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    common = shapely.area(shapely.intersection(polygons[a], polygons[b]))
    area = boxes.length * boxes.width
    iou = np.eye(len(boxes))
    iou[a, b] = np.maximum(iou[a, b], common / (area[a] + area[b] - common))
    return np.maximum(iou, iou.T)


def _merged(members: VehicleBoxes) -> VehicleBoxes:
    """One box: the size and heading of the one with most points, the mean place by points."""
    first = members[:1]
    weight = members.points / members.points.sum()
    first.centre = (weight @ members.centre)[None]
    first.group = members.group.min(keepdims=True)
    first.confidence = (weight @ members.confidence)[None]
    first.points = members.points.sum(keepdims=True)
    first.seen_at = members.seen_at.max(keepdims=True)
    return first
