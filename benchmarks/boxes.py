"""Boxes of vehicles on real drives against labelled ones: how much of an error is the car's place, how much the box.

Each drive is judged as told; moved as a whole onto the true path, as the error of a trajectory is measured; and with
each feature moved by what the pose was off in the frame that saw its vehicle well. The truth serves to measure, after
the car has told all that it tells.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from autowaze.evaluation.datum import Start, map_from_world, starting_point, true_poses
from autowaze.evaluation.departure import RememberingSegmenter
from autowaze.evaluation.drive import run_drive
from autowaze.evaluation.experiments.judging import DrivenSeries, overlaps, service_after
from autowaze.evaluation.experiments.passage import Passage
from autowaze.evaluation.experiments.truth import DriveTruth, read_labelled_truth
from autowaze.evaluation.experiments.variants import METHODS
from autowaze.evaluation.trajectory import align
from autowaze.traces import Trace, open_trace
from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.semantics.segmenter import BUNDLED, Segmenter, load_segmenter
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.pose import inverse
from autowaze.world.wire import encode_diff
from benchmarks.data import DRIVES, WEIGHTS

_SEEN_WELL_M = 12.0  # ahead: nearer ones at the side of the street leave the image, farther ones are worse in depth
_FUSED = next(method for method in METHODS if method.name == "fused")
_SAME_IOU = 0.1
_PLACES = "as told", "moved onto the true path as a whole", "from the true poses"


def run() -> None:
    console = Console(width=120)
    for name in (BUNDLED, WEIGHTS):
        measure(console, load_segmenter(name), Path(str(name)).name)


def measure(console: Console, inner: Segmenter, name: str) -> None:
    table = Table(
        "drive", "vehicle in", *_PLACES, title=f"{name}: box less labelled vehicle, across / along the street, m"
    )
    errors: list[list[float]] = [[] for _ in _PLACES]
    turned = []
    for folder in DRIVES:
        trace, spots = open_trace(folder), ParkingMap.from_geojson(folder / "parking_map.geojson")
        truth = read_labelled_truth(folder, map_from_world(trace.ground_truth, spots))
        passages, turned_deg = _passages(trace, RememberingSegmenter(inner), spots)
        turned.append(f"{trace.name} by {turned_deg:.1f} degrees")
        off = [
            _off(DrivenSeries(trace.name, spots, None, (trace.name,), (passage,), (truth,)), trace)
            for passage in passages
        ]
        for row, spot in enumerate(spot for spot in truth.spots if spot.counts and spot.vehicle >= 0):
            table.add_row(trace.name, spot.spot_id, *(f"{a:+.2f} / {b:+.2f}" for a, b in (one[row] for one in off)))
        for of_place, one in zip(errors, off, strict=True):
            of_place.extend(np.linalg.norm(one, axis=1).tolist())
        medians = [f"{np.nanmedian(np.linalg.norm(one, axis=1)):.2f}" for one in off]
        table.add_row(trace.name, "median distance", *medians, end_section=True)
    table.add_row("both", "median distance", *(f"{np.nanmedian(of_place):.2f}" for of_place in errors))
    table.caption = "as a whole turned: " + ", ".join(turned)
    console.print(table)


def _passages(trace: Trace, segmenter: Segmenter, spots: ParkingMap) -> tuple[list[Passage], float]:
    """The drive as told by a car that knows the spots; and by one that does not, moved in two ways.

    Second, by how many degrees about the vertical the drive as a whole is turned onto the true path.
    """
    start, passages = starting_point(trace, spots, Start.FIRST_TRUE_POSE), []
    for known in (spots, None):
        node = VehicleNode(trace.camera, segmenter, start=start, session=1, spots=known)
        record = run_drive(trace, node, lambda message: None)
        if known:
            passages.append(Passage(record.messages))
    told, true = record.T_map_cam, true_poses(trace, spots)
    whole = align(told[:, :3, 3], true[:, :3, 3])
    for poses in (whole @ told, true):
        passages.append(Passage([encode_diff(_moved(diff, told, poses)) for diff in record.diffs]))
    return passages, float(np.degrees(np.arctan2(whole[1, 0], whole[0, 0])))


def _moved(diff: SemanticMapDiff, told: NDArray[np.float64], poses: NDArray[np.float64]) -> SemanticMapDiff:
    """Features and path as they are when the told poses (N, 4, 4) are replaced by others; ground stays."""
    position, path = diff.new.position, diff.trajectory
    ahead = np.einsum("nj,mnj->mn", told[:, :3, 2], position[:, None] - told[:, :3, 3])
    motion = (poses @ inverse(told))[np.abs(ahead - _SEEN_WELL_M).argmin(axis=1)]
    moved = np.einsum("mij,mj->mi", motion[:, :3, :3], position) + motion[:, :3, 3]
    frame = np.linalg.norm(path.position[:, None] - told[:, :3, 3], axis=2).argmin(axis=1)
    return replace(
        diff,
        new=replace(diff.new, position=moved),
        trajectory=replace(path, position=poses[frame, :3, 3].copy()),
    )


def _off(series: DrivenSeries, trace: Trace) -> NDArray[np.float64]:
    """Box less vehicle (V, 2), away from the street and onward along it, of those that count; NaN without a box."""
    truth, boxes = series.truths[0], service_after(series, _FUSED, series.names[0]).vehicle_boxes
    path = true_poses(trace, series.spots)[:, :2, 3]
    iou, rows = overlaps(truth.corners, boxes.corners), []
    for vehicle in (spot.vehicle for spot in truth.spots if spot.counts and spot.vehicle >= 0):
        best = int(iou[vehicle].argmax())
        error = boxes.centre[best] - truth.centre[vehicle] if iou[vehicle, best] >= _SAME_IOU else np.full(2, np.nan)
        rows.append(_street_axes(truth, vehicle, path) @ error)
    return np.array(rows)


def _street_axes(truth: DriveTruth, vehicle: int, path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (2, 2) away from the street and onward along it: of the vehicle's two axes."""
    nearest = int(np.linalg.norm(path - truth.centre[vehicle], axis=1).argmin())
    onward = path[min(nearest + 3, len(path) - 1)] - path[max(nearest - 3, 0)]
    sin, cos = np.sin(truth.heading[vehicle]), np.cos(truth.heading[vehicle])
    axes = np.array([[sin, cos], [cos, -sin]])
    axes = axes[np.argsort(np.abs(axes @ onward))]
    return axes * np.sign([axes[0] @ (truth.centre[vehicle] - path[nearest]), axes[1] @ onward])[:, None]
