"""`autowaze evaluate network`: bytes up and down."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
from autowaze.cloud.service import CloudService
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import run_drive
from autowaze.evaluation.network import THESIS_FIGURES, TileFetches, content_metrics, network_metrics
from autowaze.evaluation.report import report, write_report
from autowaze.vehicle.node import VehicleNode
from autowaze.world.errors import AutowazeError
from autowaze.world.map_file import load_map
from autowaze.world.parking import ParkingMap


def network_bytes(
    traces: Annotated[list[Path], typer.Argument(help="Folders of stereo drives.", show_default=False)],
    spots: Annotated[list[Path] | None, typer.Option(help="Parking map of each trace, GeoJSON.")] = None,
    stored_map: Annotated[list[Path] | None, typer.Option("--map", help="Stored map of each trace.")] = None,
    model: Model = None,
    start: Annotated[Start, typer.Option(help="What the car knows of where it starts.")] = Start.FIRST_TRUE_POSE,
    cameras: Cameras = "auto",
    frames: Frames = "",
    json_file: JsonFile = None,
) -> None:
    """Bytes per window of 5 s and per km, up and down, by content (thesis, sec. 4.5).

    Without --map everything is new to the map. Up are the diffs as sent; down is what a car that follows the map
    would fetch: the tiles around it once (down_first_bytes), then what changed in them.

    Examples:

        autowaze evaluate network kitti/odometry_00 --json network.json

        autowaze evaluate network drives/tuesday --map monday.map
    """
    spot_files = spots or [path / "parking_map.geojson" for path in traces]
    maps: list[Path | None] = [*stored_map] if stored_map else [None] * len(traces)
    if not len(traces) == len(spot_files) == len(maps):
        raise AutowazeError(f"{len(traces)} traces need as many --spots and --map files, or none of either")
    segmentation = segmenter(model)
    results: dict[str, dict[str, float]] = {}
    for path, spot_file, map_file in zip(traces, spot_files, maps, strict=True):
        source, parking = opened(path, cameras, frames), ParkingMap.from_geojson(spot_file)
        base_map = load_map(map_file) if map_file else None
        fetches = TileFetches(CloudService(parking, base_map=base_map))
        begin = starting_point(source, parking, start)
        if begin.T_map_cam is not None:
            fetches.begin(begin.T_map_cam[:3, 3])
        node = VehicleNode(source.camera, segmentation, stored_map=base_map, start=begin, session=1, spots=parking)
        record = run_drive(source, node, fetches.receive, show_progress)
        name = source.name if source.name not in results else str(path)
        results[name] = {
            "distance_m": record.distance_m,
            "localized_fraction": record.localized_fraction,
            **network_metrics(record),
            **content_metrics(record),
            **fetches.metrics(record),
        }
    print_metrics("network (bytes; a diff is a window of 5 s)", {**results, "thesis": THESIS_FIGURES})
    if json_file:
        inputs = {
            "traces": [str(path) for path in traces],
            "spots": [str(path) for path in spot_files],
            "maps": [str(path) for path in stored_map or []],
            "start": str(start),
            "model": str(model),
            "frames": frames,
        }
        write_report(json_file, report(inputs, results))
        console.print(f"written to {json_file}")
