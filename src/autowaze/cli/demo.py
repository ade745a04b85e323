"""`autowaze demo`: the whole loop on a simulated street."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from autowaze.cli.options import JsonFile, console, print_metrics, segmenter
from autowaze.evaluation.demonstration import demonstrate
from autowaze.evaluation.latency import latency_metrics
from autowaze.evaluation.network import network_metrics
from autowaze.evaluation.report import report, write_report
from autowaze.world.frame import StereoFrame
from autowaze.world.parking import Occupancy

_SHOWN = (
    "precision", "recall", "accuracy", "spots", "localized_fraction", "track_ms_median", "end_to_end_ms_median",
    "diff_bytes_median", "bytes_per_km", "removed_features",
)  # fmt: skip


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for drives, map and picture.")] = Path(
        "out/demo"
    ),
    street: Annotated[str, typer.Option(help="A preset of the simulator or a .toml file.")] = "town-a",
    model: Annotated[
        Path, typer.Option(help="Segmentation model; none goes by free ground and obstacles alone.")
    ] = Path("none"),
    json_file: JsonFile = None,
) -> None:
    """Simulate a street, map it, drive it again with other cars parked, and say which spots are free.

    Example:

        autowaze demo --street town-b -o /tmp/demo
    """
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:

        def rendering(title: str) -> Callable[[int, int], None]:
            task = bar.add_task(f"rendering the {title}", total=None)
            return lambda done, total: bar.update(task, completed=done, total=total)

        def driving(frames: Iterable[StereoFrame], total: int) -> Iterable[StereoFrame]:
            return bar.track(frames, total=total, description="driving")

        shown = demonstrate(street, output, segmenter(model), rendering, driving)
    counts = {state: sum(s.occupancy is state for s in shown.cloud.states) for state in Occupancy}
    console.print(", ".join(f"{n} {state}" for state, n in counts.items()) + f" of {len(shown.cloud.states)} spots")
    metrics = {
        **shown.scores.metrics(),
        "localized_fraction": shown.record.localized_fraction,
        **latency_metrics(shown.record, shown.node, shown.cloud),
        **network_metrics(shown.record),
    }
    print_metrics(f"{shown.trace.name}, model {model}", {"": {k: metrics[k] for k in _SHOWN if k in metrics}})
    console.print(f"picture: {shown.picture}")
    if json_file:
        write_report(json_file, report({"street": street, "model": str(model)}, {shown.trace.name: metrics}))
