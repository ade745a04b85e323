"""A survey's diffs where the drive was found to have been, once its loops were closed.

A car on the road sends each window as it knows the map then, and takes nothing back. A survey becomes a map file after
the drive, so its windows can be moved first, each feature as the car was moved at the frame that saw it from nearest;
and what the drive saw again after a loop is told once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from autowaze.evaluation.drive import DriveRecord
from autowaze.vehicle.slam.loops.closer import LoopCloser
from autowaze.vehicle.slam.loops.correction import DriveCorrection
from autowaze.world.feature_map import MapFeatures
from autowaze.world.identity import feature_ids
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.wire import encode_diff

_SAME_M, _SAME_BITS = 0.3, 50  # of one corner seen on two passes
_NEIGHBOURS = 8


def correct_loops(record: DriveRecord, loops: LoopCloser) -> None:
    """Move the diffs of a finished drive to where its closed loops and a last adjustment put it; messages likewise."""
    if not loops.loops:
        return
    loops.adjust()
    correction = DriveCorrection(loops, record.T_map_cam)
    times = np.array([t.timestamp for t in record.tracked])
    earlier = MapFeatures.empty()
    for number, diff in enumerate(record.diffs):
        moved = _moved(diff, correction, times, record.T_map_cam[:, :3, 3])
        again = _seen_before(moved.new, earlier)
        kept = moved.new[~again]
        ids = feature_ids(diff.session, diff.sequence, len(kept))
        record.diffs[number] = replace(moved, new=replace(kept, id=ids))
        record.messages[number] = encode_diff(record.diffs[number])
        earlier = MapFeatures.concatenate([earlier, kept])


def _moved(
    diff: SemanticMapDiff, correction: DriveCorrection, times: NDArray[np.float64], camera: NDArray[np.float64]
) -> SemanticMapDiff:
    """The diff with its features and its path where they are known to be after the drive."""
    window = np.flatnonzero((times >= diff.start - 1e-6) & (times <= diff.end + 1e-6))
    told = int(window[-1])
    nearest = window[cKDTree(camera[window]).query(diff.new.position)[1]] if len(diff.new) else window[:0]
    position = correction.points(diff.new.position, nearest, told)
    on_path = np.clip(np.searchsorted(times, diff.trajectory.time - 1e-6), 0, len(times) - 1)
    path = replace(diff.trajectory, position=correction.poses()[on_path, :3, 3])
    return replace(diff, new=replace(diff.new, position=position), trajectory=path)


def _seen_before(new: MapFeatures, earlier: MapFeatures) -> NDArray[np.bool_]:
    """Mask (N,) of the described features that earlier windows had already."""
    again = np.zeros(len(new), np.bool_)
    known, rows = earlier[earlier.described], np.flatnonzero(new.described)
    if not len(known) or not len(rows):
        return again
    distance, near = cKDTree(known.position).query(new.position[rows], k=min(_NEIGHBOURS, len(known)))
    distance, near = np.reshape(distance, (len(rows), -1)), np.reshape(near, (len(rows), -1))
    unlike = known.descriptor[np.minimum(near, len(known) - 1)] ^ new.descriptor[rows, None]
    bits = np.bitwise_count(unlike).sum(axis=2)
    again[rows] = ((distance < _SAME_M) & (bits <= _SAME_BITS)).any(axis=1)
    return again
