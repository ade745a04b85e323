"""`autowaze evaluate`: everything scored against ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from autowaze.cli.evaluate_accuracy import accuracy
from autowaze.cli.evaluate_all import everything
from autowaze.cli.evaluate_benefits import benefits
from autowaze.cli.evaluate_network import network_bytes
from autowaze.cli.evaluate_poses import localization, odometry
from autowaze.cli.evaluate_semantics import segmentation, tracking
from autowaze.cli.options import (
    Cameras,
    Frames,
    JsonFile,
    Model,
    console,
    opened,
    print_metrics,
    segmenter,
    show_progress,
)
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.latency import published_metrics
from autowaze.evaluation.published import published_passes
from autowaze.evaluation.report import report, write_report
from autowaze.world.parking import ParkingMap

app = typer.Typer(help="Score the system against ground truth.", no_args_is_help=True)
app.command("all")(everything)
app.command()(accuracy)
app.command()(segmentation)
app.command()(tracking)
app.command()(benefits)
app.command("network")(network_bytes)
app.command()(odometry)
app.command()(localization)

Traces = Annotated[list[Path], typer.Argument(help="Folders of stereo drives with ground truth.", show_default=False)]
Results = dict[str, dict[str, float]]


@app.command()
def latency(
    traces: Traces,
    spots: Annotated[list[Path] | None, typer.Option(help="Parking map of each trace, GeoJSON.")] = None,
    model: Model = None,
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.FIRST_TRUE_POSE,
    method: Annotated[str, typer.Option(help="How the cloud decides: thesis or fused.")] = "fused",
    cameras: Cameras = "auto",
    frames: Frames = "",
    passes: Annotated[int, typer.Option(help="How often to drive: first with an empty map, then with it.", min=1)] = 3,
    json_file: JsonFile = None,
) -> None:
    """Milliseconds per stage on the car and in the cloud, and from a window's last frame to who follows the changes.

    Car, service and listener run on this machine at the pace of the cameras; drive on one that does nothing else.

    Example:

        autowaze evaluate latency kitti/odometry_00
    """
    spot_files = spots or [path / "parking_map.geojson" for path in traces]
    network = segmenter(model)
    results: Results = {}
    for path, spot_file in zip(traces, spot_files, strict=True):
        source = opened(path, cameras, frames)
        begin = starting_point(source, ParkingMap.from_geojson(spot_file), start)
        found = published_passes(source, spot_file, network, begin, passes, method, show_progress)
        results[source.name] = published_metrics(*found)
    _deliver("latency", {"traces": [str(p) for p in traces], "model": str(model)}, results, json_file)


def _deliver(title: str, inputs: dict[str, Any], results: Results, json_file: Path | None) -> None:
    print_metrics(title, results)
    if json_file:
        write_report(json_file, report(inputs, results))
        console.print(f"written to {json_file}")
