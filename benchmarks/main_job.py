"""The main job's bars on real drives: accuracy of spots, two rigs, cars that left, bytes, determinism."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.table import Table

from autowaze.cloud.service import CloudService
from autowaze.evaluation.accuracy import Confusion, confusion, read_truth
from autowaze.evaluation.base_map import build_base_map
from autowaze.evaluation.datum import Start, map_from_world, starting_point, true_poses
from autowaze.evaluation.departure import ParkedVehicle, RememberingSegmenter, depart, features_of
from autowaze.evaluation.drive import run_drive
from autowaze.evaluation.localization import localization_errors, removal_metrics
from autowaze.traces import open_trace
from autowaze.traces.kitti_labels import read_labels
from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.semantics.segmenter import load_segmenter
from autowaze.world.parking import ParkingMap
from benchmarks.data import DRIVES, KITTI, WEIGHTS

_METHODS = ("thesis", "fused", "carmap", "orb-slam2")
_FRAMES = slice(110, 154)  # of drive_0005, where both pairs are recorded
_SEEN_WELL_FEATURES = 20  # in the map of the first pass


def run() -> None:
    console, segmenter = Console(width=120), RememberingSegmenter(load_segmenter(WEIGHTS))
    console.print(_spots(segmenter))
    console.print(_rigs(segmenter))


def _spots(segmenter: RememberingSegmenter) -> Table:
    totals, sizes, repeated = dict.fromkeys(_METHODS, Confusion()), [], True
    for folder in DRIVES:
        trace, spots = open_trace(folder), ParkingMap.from_geojson(folder / "parking_map.geojson")
        start, messages = starting_point(trace, spots, Start.FIRST_TRUE_POSE), []
        for _ in range(2):
            node = VehicleNode(trace.camera, segmenter, start=start, session=1)
            messages.append(run_drive(trace, node, lambda message: None).messages)
        repeated &= messages[0] == messages[1]
        sizes += [len(message) for message in messages[0]]
        for method in _METHODS:
            cloud = CloudService(spots, method=method)
            for message in messages[0]:
                cloud.receive(message)
            totals[method] += confusion(cloud.states, read_truth(folder / "truth.json"))
    table = Table("method", *Confusion().metrics(), title="spots of both drives, vacant is positive")
    for method, counts in totals.items():
        table.add_row(method, *(f"{value:.3g}" for value in counts.metrics().values()))
    table.caption = f"largest diff {max(sizes)} bytes, median {np.median(sizes):.0f}; second run identical: {repeated}"
    return table


def _rigs(segmenter: RememberingSegmenter) -> Table:
    folder = KITTI / "drive_0005"
    grey, colour = open_trace(folder, "grey", _FRAMES), open_trace(folder, "colour", _FRAMES)
    _, stored = build_base_map(grey, segmenter, start=Start.FIRST_TRUE_POSE)
    node, looked_for = VehicleNode(colour.camera, segmenter, stored_map=stored, session=2), []
    record = run_drive(colour, node, lambda message: looked_for.append(node.window.looked_for))
    metrics = localization_errors(record.tracked, true_poses(colour, None)).metrics()
    metrics |= removal_metrics(record.diffs, looked_for)
    table = Table("two rigs", "value", title="drive_0005: map from the grey pair, the colour pair in it")
    for name, value in metrics.items():
        table.add_row(name, f"{value:.3f}")
    T_map_world, labels = map_from_world(colour.ground_truth, None), read_labels(folder / "label_02.txt")
    for vehicle in ParkedVehicle.from_file(folder / "vehicles.json"):
        if len(features_of(vehicle, stored, T_map_world)) >= _SEEN_WELL_FEATURES:
            left = depart(vehicle, colour, stored, labels, segmenter, T_map_world)
            text = f"{left.removed} of {left.features}; {left.others_removed} of {left.others} others"
            table.add_row(f"vehicle {left.track_id} left: features removed", text)
    return table
