"""`autowaze map`: a base map from drives."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from autowaze.cli.options import (
    Cameras,
    Frames,
    Model,
    Spots,
    console,
    opened,
    parking_map,
    segmenter,
    show_progress,
)
from autowaze.evaluation.datum import Start
from autowaze.evaluation.map_selection import FEATURES_PER_METRE
from autowaze.evaluation.street_map import map_streets
from autowaze.world.map_file import load_map, save_map


def build_map(
    traces: Annotated[
        list[Path], typer.Argument(help="Folders of stereo drives, stitched in this order.", show_default=False)
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write the map to.")],
    model: Model = None,
    spots: Spots = None,
    cameras: Cameras = "auto",
    frames: Frames = "",
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.GNSS,
    known: Annotated[
        Path | None, typer.Option("--map", help="Map to extend; it stays as it is unless --output names it.")
    ] = None,
    density: Annotated[
        float, typer.Option(min=1.0, max=1000.0, help="Features to keep for each metre of street driven.")
    ] = FEATURES_PER_METRE,
) -> None:
    """Build a base map from a drive, or from several.

    Examples:

        autowaze map drives/monday -o street.map --model yolov8n-seg.onnx

        autowaze map drives/elm drives/oak --map street.map -o quarter.map

        autowaze map kitti/drive_0005 --cameras grey --frames 110:154 --spots kitti/drive_0005/parking_map.geojson
        --start first-true-pose -o street.map
    """
    drives = [opened(trace, cameras, frames) for trace in traces]
    before = load_map(known) if known else None
    built = map_streets(drives, segmenter(model), parking_map(spots), start, before, density, show_progress)
    size = save_map(built.feature_map, output)
    added = len(built.feature_map) - (len(before) if before else 0)
    console.print(
        f"{output}: {len(built.feature_map):,} features, {added:,} of them from {built.distance_m:.0f} m of street, "
        f"{size / 1e6:.2f} MB" + ("" if before else f" ({size / 1e3 / max(built.distance_m, 1.0):.2f} MB per km)")
    )
