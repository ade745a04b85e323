"""`autowaze evaluate segmentation` and `autowaze evaluate tracking`: what the car sees of vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

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
from autowaze.evaluation.object_tracking import evaluate_object_tracking, oracle_boxes
from autowaze.evaluation.report import report, write_report
from autowaze.evaluation.segmentation import MIN_AREA, SegmenterRun, disjoint_masks, run_segmenter
from autowaze.evaluation.true_instances import Truth, open_truth
from autowaze.traces import Trace
from autowaze.vehicle.node import NodeSettings, VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter, load_segmenter
from autowaze.vehicle.semantics.street_view import StreetView
from autowaze.world.errors import AutowazeError
from autowaze.world.frame import Image
from autowaze.world.labels import is_vehicle

Traces = Annotated[list[Path], typer.Argument(help="Folders of labelled stereo drives.", show_default=False)]
MinPixels = Annotated[
    int, typer.Option(help="Vehicles with fewer visible pixels count neither way; of boxes, all inside.", min=0)
]


def segmentation(
    traces: Traces,
    model: Model = None,
    reference: Annotated[
        Path | None, typer.Option(help="Take for truth what this model finds, instead of the drives' own masks.")
    ] = None,
    reference_confidence: Annotated[
        float, typer.Option(help="From which the reference is believed.", min=0.0, max=1.0)
    ] = 0.5,
    reference_long_side: Annotated[int, typer.Option(help="Longer side of the reference's input.", min=32)] = 1248,
    min_pixels: MinPixels = MIN_AREA,
    cameras: Cameras = "auto",
    frames: Frames = "",
    json_file: JsonFile = None,
) -> None:
    """Vehicle masks against true ones: precision, recall and AP50 at IoU 0.5, by size; pairs that touch; times.

    Truth are the instance images of simulated drives or, with --reference, what another model finds.

    Example:

        autowaze evaluate segmentation street-1 street-2 --json segmentation.json

        autowaze evaluate segmentation kitti/drive_0005 --frames 0::5 --reference yolov8n-seg.onnx
    """
    judged = segmenter(model)
    teacher = (
        load_segmenter(reference, min_confidence=reference_confidence, long_side=reference_long_side)
        if reference
        else None
    )
    results: dict[str, dict[str, float]] = {}
    total = SegmenterRun()
    for path in traces:
        source = opened(path, cameras, frames)
        truth = None if teacher else open_truth(path, source)
        if truth is not None and not truth.by_pixel:
            raise AutowazeError(f"{path}: labelled by boxes, not by pixel; --reference MODEL compares with a model")
        run = run_segmenter(StreetView(judged, source.camera), _with_masks(source, truth, teacher))
        results[source.name] = run.metrics(min_pixels)
        total.frames += run.frames
        total.milliseconds += run.milliseconds
    if len(traces) > 1:
        results["all"] = total.metrics(min_pixels)
    inputs = {
        "traces": [str(p) for p in traces],
        "frames": frames,
        "model": judged.name,
        "min_pixels": min_pixels,
        "truth": "instance images" if teacher is None else teacher.name,
    }
    if teacher is not None:
        inputs |= {"reference_confidence": reference_confidence, "reference_long_side": reference_long_side}
    against = "true masks" if teacher is None else f"{teacher.name} at confidence {reference_confidence:g}"
    _deliver(f"{judged.name} against {against}, from {min_pixels} pixels on", inputs, results, json_file)


def tracking(
    traces: Traces,
    model: Model = None,
    oracle: Annotated[
        bool, typer.Option("--oracle-boxes", help="The car is given the true boxes instead of a model's.")
    ] = False,
    min_pixels: MinPixels = MIN_AREA,
    cameras: Cameras = "auto",
    frames: Frames = "",
    json_file: JsonFile = None,
) -> None:
    """Ids of vehicles over a drive (IDF1, switches, MOTA), and whether parked and moving ones are told apart.

    The whole car drives, with its own poses. Truth are the instance images of simulated drives, or KITTI's tracking
    labels. With --oracle-boxes the network is left out: what is scored is the tracking alone.

    Example:

        autowaze evaluate tracking street-1 street-2 --oracle-boxes

        autowaze evaluate tracking kitti/drive_0005 --json tracking.json
    """
    network = None if oracle else segmenter(model)
    results: dict[str, dict[str, float]] = {}
    for path in traces:
        source = opened(path, cameras, frames)
        truth = open_truth(path, source)
        eyes = network if network is not None else oracle_boxes(truth, source, min_pixels)
        begin, settings = starting_point(source, None, Start.GNSS), NodeSettings(spare_sky=not oracle)
        node = VehicleNode(source.camera, eyes, settings, start=begin, session=1)
        results[source.name] = evaluate_object_tracking(source, truth, node, min_pixels, show_progress)
    name = network.name if network is not None else "ORACLE BOXES"
    inputs = {"traces": [str(p) for p in traces], "frames": frames, "detections": name, "min_pixels": min_pixels}
    _deliver(f"tracking of vehicles from {min_pixels} pixels on; detections: {name}", inputs, results, json_file)


def _with_masks(
    trace: Trace, truth: Truth | None, reference: Segmenter | None
) -> Iterator[tuple[Image, NDArray[np.bool_]]]:
    for row, frame in enumerate(show_progress(trace, len(trace))):
        if reference is not None:
            found = reference.segment(frame.left)
            yield frame.left, disjoint_masks(found[is_vehicle(found.label)])
        elif truth is not None:
            yield frame.left, truth.instances(row).vehicles.mask


def _deliver(title: str, inputs: dict[str, Any], results: dict[str, dict[str, float]], json_file: Path | None) -> None:
    print_metrics(title, results)
    if json_file:
        write_report(json_file, report(inputs, results))
        console.print(f"written to {json_file}")
