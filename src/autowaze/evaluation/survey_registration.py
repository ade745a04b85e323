"""A survey's diffs laid onto the parking map: what they hold moves by what parked vehicles show the drive to be off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.boxes import ROW_REACH_M
from autowaze.cloud.grouping import group_by_instance, split_in_space
from autowaze.cloud.integration import MapState
from autowaze.cloud.merging import merge_boxes
from autowaze.cloud.outliers import remove_outliers
from autowaze.cloud.row_split import split_along_rows
from autowaze.cloud.spots import SpotIndex
from autowaze.cloud.visible_side import boxes_from_visible_side
from autowaze.evaluation.drive import DriveRecord
from autowaze.world.displacement import displaced
from autowaze.world.labels import is_vehicle
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.row_registration import MIN_POINTS, SCALE_SIGMA, MapShift, ParkedBoxes, shifts_along
from autowaze.world.wire import encode_diff

SURVEYED_SIGMA_M = 0.05
"""How surely the first pose is known."""


def register_survey(record: DriveRecord, spots: ParkingMap, scale_sigma: float = SCALE_SIGMA) -> None:
    """Move the diffs of a finished drive through an unknown street to where its parked vehicles say; messages likewise.

    The first pose must have been surveyed: rows of bays look the same one bay on. `scale_sigma` is of the rig, see
    `scale_sigma_of`.
    """
    if not len(spots) or not record.diffs:
        return
    index = SpotIndex(spots)
    path = record.T_map_cam[:, :2, 3]
    times = np.array([t.timestamp for t in record.tracked])
    windows = [_window(diff, times) for diff in record.diffs]
    boxes = _parked(record.diffs, windows, index, path)
    start = MapShift.at_start(SURVEYED_SIGMA_M, scale_sigma)
    shifts, _ = shifts_along(path, boxes, index.centre, start, scale_sigma)
    for number, (diff, window) in enumerate(zip(record.diffs, windows, strict=True)):
        record.diffs[number] = displaced(diff, path[window], shifts[window])
        record.messages[number] = encode_diff(record.diffs[number])


def _parked(
    diffs: list[SemanticMapDiff], windows: list[NDArray[np.int64]], spots: SpotIndex, path: NDArray[np.float64]
) -> ParkedBoxes:
    """Vehicles near spots, from all windows together."""
    state = MapState(None, spots.georeference)
    frames_of: dict[int, NDArray[np.int64]] = {}
    for diff, window in zip(diffs, windows, strict=True):
        state.integrate(diff)
        for key in np.unique(diff.new.instance_key).tolist():
            frames_of[key] = np.union1d(frames_of.get(key, window), window)
    features = state.features
    keys = np.unique(features.instance_key[is_vehicle(features.label) & (features.instance_key != 0)])
    groups = split_along_rows(split_in_space(remove_outliers(group_by_instance(state, keys))), spots)
    boxes = merge_boxes(boxes_from_visible_side(groups, spots, is_pulled=False))
    boxes = boxes[(boxes.points >= MIN_POINTS) & (spots.grid.nearest(boxes.centre, ROW_REACH_M) >= 0)]
    seen = np.zeros(len(boxes), np.int64)
    for row, (group, centre) in enumerate(zip(boxes.group.tolist(), boxes.centre, strict=True)):
        frames = frames_of[group]
        seen[row] = frames[np.linalg.norm(path[frames] - centre, axis=1).argmin()]
    return ParkedBoxes(boxes.centre, boxes.heading, boxes.points, seen)


def _window(diff: SemanticMapDiff, times: NDArray[np.float64]) -> NDArray[np.int64]:
    """Frames of a diff's window."""
    return np.flatnonzero((times >= diff.start - 1e-6) & (times <= diff.end + 1e-6))
