"""`autowaze evaluate all`: everything at once, as a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from autowaze.cli.experiments import (
    Cache,
    Jobs,
    KeepImages,
    Quick,
    Seed,
    bars,
    driven,
    judging,
    planned,
    print_scores,
)
from autowaze.cli.options import Model, console, segmenter, show_progress
from autowaze.evaluation.experiments.findings import find
from autowaze.evaluation.experiments.laboratory import Laboratory, recorded_again, street_of
from autowaze.evaluation.experiments.latency_run import measure_latency
from autowaze.evaluation.experiments.recorded_drives import driven_recording, recorded_drives
from autowaze.evaluation.experiments.whole_report import Report, command_line
from autowaze.vehicle.semantics.model_store import BUNDLED

_BENEFIT_PLACES, _QUICK_BENEFIT_PLACES, _BENEFIT_SEARCHES = 40, 4, 25
_LATENCY_DRIVES = 3


def everything(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the report.")],
    quick: Quick = False,
    cache: Cache = Path("out/experiments"),
    model: Model = None,
    seed: Seed = 0,
    jobs: Jobs = None,
    keep_images: KeepImages = False,
    as_is: Annotated[
        bool, typer.Option("--as-is", help="Judge the drives that the cache holds; drive no others.")
    ] = False,
) -> None:
    """Run everything the thesis's chapter 4 did and write report.html, report.md and results.json.

    What is in the cache already is not rendered or driven again, so a run that was cut short goes on. Real drives are
    judged too where AUTOWAZE_TEST_DATA names a folder of them.

    Examples:

        autowaze evaluate all -o report

        autowaze evaluate all -o report --quick
    """
    laboratory = Laboratory(cache, str(model or BUNDLED), keep_images)
    inputs = {"quick": quick, "seed": seed, "model": laboratory.model_name}
    said = ["all", "-o", str(output), "--cache", str(cache), "--seed", str(seed), *(["--quick"] if quick else [])]
    whole = Report(inputs, command_line(said + (["--model", str(model)] if model else [])))
    simulated = driven(laboratory, quick, seed, jobs, as_is)
    for found in simulated:
        whole.add_experiment(found)
    recordings = recorded_drives()
    if recordings:
        network = segmenter(model)
        series = [driven_recording(laboratory, folder, network, show_progress) for folder in recordings]
        whole.add_experiment(find("real", "Real drives", len(series), series, True, judging))
    whole.add_comparisons({found.name: found for found in simulated})
    street = planned(quick, seed)[0].series[0]
    with bars() as tell:
        drives = recorded_again(laboratory, street, 1 if quick else _LATENCY_DRIVES, tell)
    parking, base_map = street_of(laboratory, street)
    whole.add_latency(measure_latency(drives, parking, base_map, segmenter(model), show_progress))
    whole.add_benefits(output, _QUICK_BENEFIT_PLACES if quick else _BENEFIT_PLACES, _BENEFIT_SEARCHES, seed)
    whole.write(output)
    print_scores(whole.results)
    console.print(f"written to {output / 'report.html'}, report.md and results.json")
