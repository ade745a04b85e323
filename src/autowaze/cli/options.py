"""Options that several commands share, and the objects they name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from autowaze.traces import Trace, open_trace
from autowaze.vehicle.semantics.model_store import BUNDLED
from autowaze.vehicle.semantics.no_segmentation import NoSegmentation
from autowaze.vehicle.semantics.segmenter import Segmenter, load_segmenter
from autowaze.world.errors import AutowazeError
from autowaze.world.frame import StereoFrame
from autowaze.world.parking import ParkingMap

console = Console(highlight=False, width=None if Console().is_terminal else 160)

TracePath = Annotated[Path, typer.Argument(help="Folder of a stereo drive.", show_default=False)]
Cameras = Annotated[str, typer.Option(help="Pair of a rig with two: grey, colour or auto.")]
Frames = Annotated[str, typer.Option(help="Frame numbers to use, FIRST:UNTIL or FIRST:UNTIL:STEP.", metavar="SLICE")]
Model = Annotated[
    Path | None,
    typer.Option(
        help="Segmentation model: an .onnx or OpenVINO .xml file, a name of `autowaze models list`, or none; without "
        "this option the bundled one.",
        envvar="AUTOWAZE_MODEL",
    ),
]
Spots = Annotated[Path | None, typer.Option(help="Parking map, GeoJSON.")]
_MAX_COLUMNS = 3

JsonFile = Annotated[Path | None, typer.Option("--json", help="Also write the figures to this file.")]


def opened(path: Path, cameras: str, frames: str) -> Trace:
    """The drive that the options name."""
    return open_trace(path, cameras, parse_frames(frames))


def parse_frames(text: str) -> slice | None:
    """A slice of frame numbers; an empty text is all of them."""
    if not text:
        return None
    try:
        parts = [int(part) if part else None for part in text.split(":")]
    except ValueError as error:
        raise AutowazeError(f"--frames {text}: expected FIRST:END, such as 110:154") from error
    if len(parts) not in (2, 3) or any(part is not None and part < 0 for part in parts):
        raise AutowazeError(f"--frames {text}: expected FIRST:END, such as 110:154")
    return slice(*parts)


def parking_map(path: Path | None) -> ParkingMap | None:
    """The parking map that the option names, if it does."""
    return ParkingMap.from_geojson(path) if path else None


def segmenter(model: Path | None) -> Segmenter:
    """The segmentation model that the option names, the bundled one where it names none."""
    return NoSegmentation() if str(model) == NoSegmentation.name else load_segmenter(model or BUNDLED)


def show_progress(frames: Iterable[StereoFrame], total: int) -> Iterable[StereoFrame]:
    """The frames, with a progress bar on a terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield from progress.track(frames, total=total, description="driving")


def print_metrics(title: str, results: dict[str, dict[str, Any]]) -> None:
    """Metrics as a table: a row per metric, or a row per result where there are many results of few metrics."""
    names = list(dict.fromkeys(metric for metrics in results.values() for metric in metrics))
    by_result = len(results) > _MAX_COLUMNS
    table = Table("" if by_result else "metric", title=title, title_justify="left")
    for heading in names if by_result else results:
        table.add_column(heading.replace("_", "\n") if by_result else heading, justify="right")
    if by_result:
        for name, metrics in results.items():
            table.add_row(name, *(_formatted(metrics.get(metric)) for metric in names))
    else:
        for metric in names:
            table.add_row(metric, *(_formatted(metrics.get(metric)) for metrics in results.values()))
    console.print(table)


def _formatted(value: float | None) -> str:
    if value is None:
        return ""
    if float(value).is_integer() and (abs(value) >= 2 or value == 0):
        return f"{value:.0f}"
    return f"{value:.3f}" if abs(value) >= 0.1 else f"{value:.3g}"
