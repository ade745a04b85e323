"""`autowaze map`: a base map from a drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from autowaze.cli.options import (
    Cameras,
    Frames,
    Model,
    Spots,
    TracePath,
    console,
    opened,
    parking_map,
    segmenter,
    show_progress,
)
from autowaze.evaluation.base_map import build_base_map
from autowaze.evaluation.datum import Start
from autowaze.world.map_file import save_map


def build_map(
    trace: TracePath,
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write the map to.")],
    model: Model = None,
    spots: Spots = None,
    cameras: Cameras = "auto",
    frames: Frames = "",
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.GNSS,
) -> None:
    """Build a base map from a drive.

    Examples:

        autowaze map drives/monday -o street.map --model yolov8n-seg.onnx

        autowaze map kitti/drive_0005 --cameras grey --frames 110:154 --spots kitti/drive_0005/parking_map.geojson
        --start first-true-pose -o street.map
    """
    drive = opened(trace, cameras, frames)
    record, feature_map = build_base_map(drive, segmenter(model), parking_map(spots), start, progress=show_progress)
    size = save_map(feature_map, output)
    console.print(
        f"{output}: {len(feature_map):,} features of {record.distance_m:.0f} m of street, {size / 1e6:.2f} MB "
        f"({size / 1e3 / max(record.distance_m, 1.0):.2f} MB per km)"
    )
