"""What `evaluate accuracy` and `evaluate all` have in common: options, bars of progress, the table of scores."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from autowaze.cli.options import console, print_metrics
from autowaze.evaluation.experiments.findings import Findings, find
from autowaze.evaluation.experiments.laboratory import Laboratory, run_experiments
from autowaze.evaluation.experiments.plan import Experiment, full_experiments, quick_experiments
from autowaze.evaluation.experiments.variants import Variant
from autowaze.world.errors import AutowazeError

Results = dict[str, dict[str, float]]
_SHOWN = (
    "precision",
    "recall",
    "accuracy",
    "accuracy_low",
    "drives",
    "spots",
    "false_vacant",
    "false_occupied",
    "unknown",
    "unseen_vacant",
    "own_car",
    "centre_median_m",
)

Cache = Annotated[
    Path,
    typer.Option("--cache", help="Folder of simulated drives and of what cars sent; used again, and gone on with."),
]
Quick = Annotated[bool, typer.Option("--quick", help="A few drives only, some minutes.")]
Seed = Annotated[int, typer.Option(help="Other cars, other vacancies, other traffic.", min=0, max=900)]
Jobs = Annotated[
    int | None, typer.Option(help="Streets that are driven at the same time; a process each.", min=1, max=64)
]
KeepImages = Annotated[
    bool, typer.Option("--keep-images", help="Leave the images of driven drives in the cache, 150 MB each.")
]


def planned(quick: bool, seed: int) -> Sequence[Experiment]:
    """The experiments that the options name."""
    return quick_experiments(seed) if quick else full_experiments(seed)


def driven(laboratory: Laboratory, quick: bool, seed: int, jobs: int | None, as_is: bool = False) -> list[Findings]:
    """Drive what is missing, unless the cache is to be taken as it is, and judge every drive."""
    every = planned(quick, seed)
    if not as_is:
        with bars(sum(len(series.to_drive) for one in every for series in one.series)) as tell:
            run_experiments(laboratory, every, jobs or os.cpu_count() or 1, tell)
    found = []
    for one in every:
        series = [driven for series in one.series if (driven := laboratory.driven(series))]
        if series:
            found.append(find(one.name, one.title, len(one.judged), series, quick, judging))
    if not found:
        raise AutowazeError(f"{laboratory.folder}: holds no drive that can be judged with {laboratory.model_name}")
    return found


def judging(variants: Sequence[Variant], title: str) -> Iterable[Variant]:
    """The variants, with a bar of how many have been judged."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        yield from progress.track(variants, description=f"judging: {title}")


@contextmanager
def bars(drives: int = 0) -> Iterator[Callable[[str, int, int], None]]:
    """Progress of all drives, and of each that is being rendered or driven."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        overall = progress.add_task("drives", total=drives) if drives else None
        tasks: dict[str, TaskID] = {}

        def tell(name: str, done: int, total: int) -> None:
            if total == 1 and overall is not None:
                progress.advance(overall)
                return
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=total)
            progress.update(tasks[name], completed=done, visible=done < total)

        yield tell


def print_scores(results: Results) -> None:
    """Figures of spots, a row per method and experiment."""
    shown = {
        name: {key: metrics[key] for key in _SHOWN} for name, metrics in results.items() if "false_vacant" in metrics
    }
    print_metrics("spots (vacant is positive, unknown is an error)", shown)
