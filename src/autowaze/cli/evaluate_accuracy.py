"""`autowaze evaluate accuracy`: spots against truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from autowaze.cli.experiments import Cache, Jobs, KeepImages, Quick, Results, Seed, driven, print_scores
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
from autowaze.evaluation.accuracy import Confusion, judge_trace, read_truth
from autowaze.evaluation.datum import Start
from autowaze.evaluation.experiments.guards import breaches
from autowaze.evaluation.experiments.laboratory import Laboratory
from autowaze.evaluation.report import report, write_report
from autowaze.vehicle.semantics.model_store import BUNDLED
from autowaze.world.errors import AutowazeError
from autowaze.world.parking import ParkingMap


def accuracy(
    traces: Annotated[
        list[Path] | None, typer.Argument(help="Folders of stereo drives with ground truth; none runs the experiments.")
    ] = None,
    spots: Annotated[list[Path] | None, typer.Option(help="Parking map of each trace, GeoJSON.")] = None,
    truth: Annotated[list[Path] | None, typer.Option(help="Truth of each trace, JSON.")] = None,
    model: Model = None,
    method: Annotated[list[str] | None, typer.Option(help="thesis, fused; may be given more than once.")] = None,
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.FIRST_TRUE_POSE,
    cameras: Cameras = "auto",
    frames: Frames = "",
    quick: Quick = False,
    cache: Cache = Path("out/experiments"),
    seed: Seed = 0,
    jobs: Jobs = None,
    keep_images: KeepImages = False,
    json_file: JsonFile = None,
) -> None:
    """Vacant spots against truth: confusion matrix, precision, recall, accuracy, with vacant as positive.

    Without traces, the experiments: simulated streets as the thesis drove them, the map carried from drive to drive.
    With --quick a few drives of them, and an exit code of 1 when a figure is below what it must be.

    With traces but without --spots and --truth, parking_map.geojson and truth.json in the folder of each trace. By
    default the car is told its true pose in the first frame, as a survey would, and no other.

    Examples:

        autowaze evaluate accuracy --quick

        autowaze evaluate accuracy kitti/odometry_00 kitti/drive_0005 --method thesis --method fused
    """
    if traces:
        results = _on_traces(traces, spots, truth, model, method, start, cameras, frames)
        inputs: dict[str, Any] = {"traces": [str(p) for p in traces], "start": str(start), "model": str(model)}
        print_metrics(f"accuracy (vacant is positive; start: {start})", results)
        _deliver(inputs, results, json_file)
        return
    laboratory = Laboratory(cache, str(model or BUNDLED), keep_images)
    found = driven(laboratory, quick, seed, jobs)
    results = {name: metrics for one in found for name, metrics in one.metrics().items()}
    print_scores(results)
    _deliver({"quick": quick, "seed": seed, "model": laboratory.model_name}, results, json_file)
    below = breaches(results) if quick else []
    for words in below:
        console.print(f"below its bound: {words}", markup=False)
    if below:
        raise typer.Exit(1)


def _on_traces(
    traces: list[Path],
    spots: list[Path] | None,
    truth: list[Path] | None,
    model: Path | None,
    method: list[str] | None,
    start: Start,
    cameras: str,
    frames: str,
) -> Results:
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
        found = judge_trace(source, parking, read_truth(truth_file), methods, network, start, show_progress)
        for name, counts in found.items():
            totals[name] += counts
            results[f"{source.name} {name}"] = counts.metrics()
    if len(traces) > 1:
        results.update({f"all {name}": counts.metrics() for name, counts in totals.items()})
    return results


def _deliver(inputs: dict[str, Any], results: Results, json_file: Path | None) -> None:
    if json_file:
        write_report(json_file, report(inputs, results))
        console.print(f"written to {json_file}")
