"""`autowaze evaluate`: everything scored against ground truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from autowaze.cli.evaluate_benefits import benefits
from autowaze.cli.options import (
    Cameras,
    Frames,
    JsonFile,
    Model,
    Spots,
    console,
    opened,
    parking_map,
    print_metrics,
    segmenter,
    show_progress,
)
from autowaze.cloud.service import CloudService
from autowaze.evaluation.accuracy import Confusion, confusion, read_truth
from autowaze.evaluation.datum import Start, starting_point, true_poses
from autowaze.evaluation.drive import run_drive
from autowaze.evaluation.latency import latency_metrics
from autowaze.evaluation.localization import localization_errors, removal_metrics
from autowaze.evaluation.network import network_metrics
from autowaze.evaluation.odometry import odometry_metrics, run_odometry
from autowaze.evaluation.report import report, write_report
from autowaze.vehicle.diffing.removal import LookedFor
from autowaze.vehicle.node import VehicleNode
from autowaze.world.errors import AutowazeError
from autowaze.world.map_file import load_map
from autowaze.world.parking import ParkingMap

app = typer.Typer(help="Score the system against ground truth.", no_args_is_help=True)
app.command()(benefits)

Traces = Annotated[list[Path], typer.Argument(help="Folders of stereo drives with ground truth.", show_default=False)]
Results = dict[str, dict[str, float]]


@app.command()
def odometry(traces: Traces, cameras: Cameras = "auto", frames: Frames = "", json_file: JsonFile = None) -> None:
    """Visual odometry against true poses: RPE per frame, APE after alignment, times.

    Example:

        autowaze evaluate odometry kitti/odometry_00 kitti/drive_0005 --json odometry.json
    """
    results: Results = {}
    for path in traces:
        trace = opened(path, cameras, frames)
        T_true = true_poses(trace, None)
        results[trace.name] = odometry_metrics(run_odometry(trace, show_progress), T_true)
    _deliver("odometry", {"traces": [str(p) for p in traces], "frames": frames}, results, json_file)


@app.command()
def localization(
    trace: Annotated[Path, typer.Argument(help="Folder of a stereo drive with ground truth.", show_default=False)],
    stored_map: Annotated[Path, typer.Option("--map", help="Stored map to localise in.")],
    spots: Spots = None,
    model: Model = None,
    cameras: Cameras = "auto",
    frames: Frames = "",
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.GNSS,
    json_file: JsonFile = None,
) -> None:
    """Localisation in a stored map against true poses, and what the diffs say of a map that did not change.

    Example: base map from one pair of a rig, localise the other in it.

        autowaze map kitti/drive_0005 --cameras grey --frames 110:154 --start first-true-pose -o grey.map

        autowaze evaluate localization kitti/drive_0005 --cameras colour --frames 110:154 --map grey.map
    """
    source, parking = opened(trace, cameras, frames), parking_map(spots)
    base_map = load_map(stored_map)
    told = starting_point(source, parking, start)
    node = VehicleNode(source.camera, segmenter(model), stored_map=base_map, start=told)
    looked_for: list[LookedFor] = []
    record = run_drive(source, node, lambda message: looked_for.append(node.window.looked_for), show_progress)
    errors = localization_errors(record.tracked, true_poses(source, parking)).metrics()
    metrics = {**errors, **removal_metrics(record.diffs, looked_for), **network_metrics(record)}
    _deliver("localization", {"trace": str(trace), "map": str(stored_map)}, {source.name: metrics}, json_file)


@app.command()
def accuracy(
    traces: Traces,
    spots: Annotated[list[Path] | None, typer.Option(help="Parking map of each trace, GeoJSON.")] = None,
    truth: Annotated[list[Path] | None, typer.Option(help="Truth of each trace, JSON.")] = None,
    model: Model = None,
    method: Annotated[list[str] | None, typer.Option(help="thesis, fused; may be given more than once.")] = None,
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.FIRST_TRUE_POSE,
    cameras: Cameras = "auto",
    frames: Frames = "",
    json_file: JsonFile = None,
) -> None:
    """Vacant spots against truth: confusion matrix, precision, recall, accuracy, with vacant as positive.

    Without --spots and --truth, parking_map.geojson and truth.json in the folder of each trace. By default the car is
    told its true pose in the first frame, as a survey would, and no other.

    Example:

        autowaze evaluate accuracy kitti/odometry_00 kitti/drive_0005 --method thesis --method fused
    """
    spot_files = spots or [path / "parking_map.geojson" for path in traces]
    truth_files = truth or [path / "truth.json" for path in traces]
    if not len(traces) == len(spot_files) == len(truth_files):
        raise AutowazeError(f"{len(traces)} traces need as many --spots and --truth files, or none of either")
    methods = method or ["thesis", "fused"]
    network = segmenter(model)
    results: Results = {}
    totals = dict.fromkeys(methods, Confusion())
    for path, spot_file, truth_file in zip(traces, spot_files, truth_files, strict=True):
        source, parking = opened(path, cameras, frames), ParkingMap.from_geojson(spot_file)
        clouds = {name: CloudService(parking, method=name) for name in methods}
        begin = starting_point(source, parking, start)
        node = VehicleNode(source.camera, network, start=begin, session=1, spots=parking)
        run_drive(source, node, _for_all(list(clouds.values())), show_progress)
        for name, cloud in clouds.items():
            counts = confusion(cloud.states, read_truth(truth_file))
            totals[name] += counts
            results[f"{source.name} {name}"] = counts.metrics()
    if len(traces) > 1:
        results.update({f"all {name}": counts.metrics() for name, counts in totals.items()})
    inputs = {"traces": [str(p) for p in traces], "methods": methods, "start": str(start), "model": str(model)}
    _deliver(f"accuracy (vacant is positive; start: {start})", inputs, results, json_file)


@app.command()
def latency(
    traces: Traces,
    spots: Annotated[list[Path] | None, typer.Option(help="Parking map of each trace, GeoJSON.")] = None,
    model: Model = None,
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.FIRST_TRUE_POSE,
    method: Annotated[str, typer.Option(help="How the cloud decides: thesis or fused.")] = "fused",
    cameras: Cameras = "auto",
    frames: Frames = "",
    json_file: JsonFile = None,
) -> None:
    """Milliseconds per stage on the car and in the cloud, and from a window's last frame to the update.

    Example:

        autowaze evaluate latency kitti/odometry_00
    """
    spot_files = spots or [path / "parking_map.geojson" for path in traces]
    network = segmenter(model)
    results: Results = {}
    for path, spot_file in zip(traces, spot_files, strict=True):
        source, parking = opened(path, cameras, frames), ParkingMap.from_geojson(spot_file)
        cloud = CloudService(parking, method=method)
        begin = starting_point(source, parking, start)
        node = VehicleNode(source.camera, network, start=begin, session=1, spots=parking)
        record = run_drive(source, node, cloud.receive, show_progress)
        results[source.name] = {**latency_metrics(record, node, cloud), **network_metrics(record)}
    _deliver("latency", {"traces": [str(p) for p in traces], "model": str(model)}, results, json_file)


def _for_all(clouds: list[CloudService]) -> Callable[[bytes], None]:
    """Gives each diff to all of them: one drive, judged by every method."""

    def receive(message: bytes) -> None:
        for cloud in clouds:
            cloud.receive(message)

    return receive


def _deliver(title: str, inputs: dict[str, Any], results: Results, json_file: Path | None) -> None:
    print_metrics(title, results)
    if json_file:
        write_report(json_file, report(inputs, results))
        console.print(f"written to {json_file}")
