"""What came out of the demonstration, as a table for a terminal."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rich.table import Table

from autowaze.cli.options import console
from autowaze.evaluation.accuracy import Confusion
from autowaze.evaluation.demonstration.outcome import CarOutcome, Outcome
from autowaze.world.parking import Occupancy

_CAR_STAGES = (
    "segmentation",
    "features",
    "foretelling",
    "dense stereo",
    "object tracking",
    "association",
    "slam",
    "motion",
    "ground",
    "diff",
    "closing",
)


def show_outcome(outcome: Outcome) -> None:
    """Print it, a column per car and one for all of them."""
    every = outcome.metrics()
    table = Table("", title="against the truth, opened only now", title_justify="left")
    for car in outcome.cars:
        table.add_column(f"{car.name}\n{car.street}", justify="right")
    table.add_column("all", justify="right", style="bold")

    def row(title: str, of_car: Callable[[CarOutcome], str], of_all: str = "") -> None:
        table.add_row(title, *map(of_car, outcome.cars), of_all)

    def scores(title: str, value: Callable[[Confusion], float], form: str) -> None:
        row(title, lambda car: format(value(car.scores), form), format(value(outcome.scores), form))

    def metric(title: str, name: str, form: str = ".0f", scale: float = 1.0) -> None:
        values = [car.metrics().get(name) for car in outcome.cars]
        shown = ["" if value is None else format(scale * value, form) for value in values]
        table.add_row(title, *shown, format(scale * every[name], form) if name in every else "")

    scores("accuracy", lambda s: s.accuracy, ".3f")
    scores("precision, of free spots", lambda s: s.precision, ".3f")
    scores("recall, of free spots", lambda s: s.recall, ".3f")
    scores("spots that the car could see", lambda s: s.total, ".0f")
    scores("taken, but called free", lambda s: s.false_vacant, ".0f")
    scores("free, but called taken", lambda s: s.false_occupied, ".0f")
    scores("not called", lambda s: s.unknown_vacant + s.unknown_occupied, ".0f")
    changed = f"{outcome.changes_noticed} of {outcome.changes}"
    table.add_row("turned free or taken, and noticed", *([""] * (len(outcome.cars) - 1)), changed, changed)
    table.add_section()
    metric("frames localised in the map, %", "localized_fraction", ".1f", 100.0)
    metric("position error, median, cm", "position_error_median_cm", ".1f")
    table.add_section()
    for stage in _CAR_STAGES:
        metric(f"{stage}, median ms", f"{stage.replace(' ', '_')}_ms_median", ".1f")
    for stage, ms in outcome.stages_ms.items():
        table.add_row(f"service: {stage}, median ms", *([""] * len(outcome.cars)), f"{ms:.1f}")
    end_to_end = [f"{np.median(car.report.end_to_end_ms):.0f}" for car in outcome.cars]
    table.add_row("end to end, median ms", *end_to_end, f"{every['end_to_end_ms_median']:.0f}")
    table.add_section()
    metric("diffs", "diffs")
    metric("bytes per diff, median", "diff_bytes_median")
    metric("bytes per diff, largest", "diff_bytes_max")
    metric("kilobytes per km", "bytes_per_km", ".0f", 0.001)
    console.print(table)
    counts = outcome.counts()
    total = sum(counts.values())
    told = ", ".join(f"{counts[state]} {state}" for state in Occupancy)
    console.print(f"the map now shows {told} of {total} spots")
    right = outcome.scores.true_vacant + outcome.scores.true_occupied
    console.print(f"accuracy {outcome.scores.accuracy:.3f}: {right} of {outcome.scores.total} spots told rightly")
