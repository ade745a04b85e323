"""`autowaze evaluate all` in one page: drive, judge, time, count, write."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from autowaze.evaluation.benefits.costs import Rates
from autowaze.evaluation.benefits.picture import draw_benefits
from autowaze.evaluation.benefits.places import PlaceKind
from autowaze.evaluation.benefits.study import THESIS_FIGURES, SearchLengths, search_places, thesis_metrics
from autowaze.evaluation.benefits.thesis_lot import thesis_lot
from autowaze.evaluation.experiments import chapters, printed
from autowaze.evaluation.experiments.figures import draw_stages
from autowaze.evaluation.experiments.findings import Findings
from autowaze.evaluation.experiments.latency_run import END_TO_END, StageTable
from autowaze.evaluation.report import report
from autowaze.evaluation.reporting.document import Block, Commands, Document, Picture, Section, Table, Text
from autowaze.evaluation.reporting.html_page import html_of
from autowaze.evaluation.reporting.markdown_page import PICTURES, markdown_of
from autowaze.world.errors import AutowazeError

END_TO_END_MS = 100.0
_BESIDE_SEGMENTATION = ("features", "foretelling", "dense stereo")
"""What the thesis reached with a GPU (sec. 4.3), and what is aimed at without."""
_OCCUPANCIES = (0.7, 0.85, 0.95, 1.0)


@dataclass
class Report:
    """What `evaluate all` found, as it comes in.

    Attributes:
        findings: by name of the experiment.
        inputs: what the command was given.
        results: flat metrics by name.
    """

    inputs: dict[str, Any]
    command: str
    findings: dict[str, Findings] = field(default_factory=dict)
    results: dict[str, dict[str, float]] = field(default_factory=dict)
    sections: list[Section] = field(default_factory=list)

    def add_experiment(self, found: Findings) -> None:
        """Take in what was found of one experiment."""
        self.findings[found.name] = found
        self.results |= found.metrics()
        self.sections.append(chapters.spots_section(found))
        self.sections.append(chapters.confusion_section(found))

    def add_comparisons(self, simulated: Mapping[str, Findings]) -> None:
        """Calibration, ablations, maps that are off and bytes, over simulated experiments."""
        self.sections.append(chapters.calibration_section(simulated))
        for found in simulated.values():
            if "thesis, no second pass" in found.judged:
                self.sections += [chapters.ablation_section(found), chapters.offset_section(found)]
        self.sections.append(chapters.network_section(simulated))

    def add_latency(self, table: StageTable) -> None:
        """Take in times."""
        self.results["latency"] = table.metrics()
        summary = table.summary()
        tracking = sum(summary[stage][0] for stage in ("features", "slam") if stage in summary)
        cloud = sum(median for stage, (median, _) in summary.items() if stage.startswith("cloud"))
        thesis = {
            "slam": f"{printed.LATENCY_MS['tracking']:.0f} with features; here {tracking:.0f}",
            "closing": f"{printed.LATENCY_MS['diff']:.0f}, the diff in all",
            "cloud: occupancy": f"{printed.LATENCY_MS['cloud']:.0f} in all; here {cloud:.0f}",
            END_TO_END: f"{printed.LATENCY_MS['end to end']:.0f}, with a GPU",
        }
        rows = tuple(
            (stage, f"{median:.1f}", f"{p95:.1f}", thesis.get(stage, "")) for stage, (median, p95) in summary.items()
        )
        strong = frozenset(row for row, stage in enumerate(summary) if stage == END_TO_END)
        blocks: list[Block] = [
            Text(
                "Milliseconds; stages of the car per frame, of the ground per look, of closing and of the cloud per "
                "diff. Features, foretelling and dense stereo run beside segmentation. End to end is from the last "
                "frame of a window to the published update, all in one process. "
                f"When this began, {table.others_busy:.1f} processes wanted a core."
            ),
            Text(_where_time_goes(summary)),
            Table(("stage", "median", "p95", "thesis, sec. 4.3"), rows, strong),
            Picture("latency", draw_stages(summary, END_TO_END_MS), "Milliseconds by stage; the line is at 100 ms"),
        ]
        self.sections.append(Section("Latency", blocks))

    def add_benefits(self, folder: Path, places: int, searches: int, seed: int) -> None:
        """Search for spots with and without Autowaze, and take in what comes out."""
        rates, rng, lot = Rates(), np.random.default_rng(seed), thesis_lot()
        on_lot = thesis_metrics(lot, rates)
        self.results["benefits, thesis lot"] = on_lot
        lengths: dict[tuple[PlaceKind, float], SearchLengths] = {}
        rows = []
        for kind in PlaceKind:
            for share, searched in search_places(kind, _OCCUPANCIES, places, searches, seed).items():
                lengths[kind, share] = searched
                metrics = searched.metrics(rates, rng)
                self.results[f"benefits, {kind} {share:.2f}"] = metrics
                taken = "all but one" if share == 1.0 else f"{share:.0%}"
                saved = f"{metrics['saved_fraction']:.0%} ({metrics['saved_low']:.0%} to {metrics['saved_high']:.0%})"
                rows.append(
                    (f"{kind}, {taken}", f"{metrics['without_mean_m']:.0f}", f"{metrics['with_mean_m']:.0f}", saved)
                )
        picture = folder / PICTURES / "benefits.png"
        draw_benefits(picture, lot, lengths)
        compared = tuple((name, f"{on_lot[name]:.4g}", f"{value:.4g}") for name, value in THESIS_FIGURES.items())
        blocks: list[Block] = [
            Text("The thesis's car park of 80 m x 30 m, the spot found last; lengths follow from the lanes."),
            Table(("figure", "from the lanes", "thesis, sec. 4.4"), compared),
            Picture("benefits", picture.read_bytes(), "Ways through the car park, and search lengths by spots taken"),
            Text(
                f"Searches drawn in {places} places of each kind, {searches} in each; metres, and what knowing saves."
            ),
            Table(("place, spots taken", "without, mean m", "with, mean m", "saved (95 %)"), tuple(rows)),
        ]
        self.sections.append(Section("Benefits", blocks))

    def write(self, folder: Path) -> None:
        """`report.html`, `report.md` with its pictures, `results.json`.

        Raises:
            AutowazeError: the folder cannot be written.
        """
        facts = report(self.inputs, self.results)
        document = Document("Autowaze: evaluation", [*self.sections, self._made_of(facts)])
        try:
            (folder / PICTURES).mkdir(parents=True, exist_ok=True)
            for picture in document.pictures:
                (folder / PICTURES / f"{picture.name}.png").write_bytes(picture.png)
            (folder / "report.html").write_text(html_of(document), encoding="utf-8")
            (folder / "report.md").write_text(markdown_of(document), encoding="utf-8")
            (folder / "results.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise AutowazeError(f"{folder}: the report cannot be written: {error.strerror}") from error

    def _made_of(self, facts: dict[str, Any]) -> Section:
        seeds = tuple(
            (
                f"{one.street}",
                f"{len(one.names)}",
                f"{one.names[0]} to {one.names[-1]}",
            )
            for found in self.findings.values()
            for one in found.series
        )
        versions = tuple((name, str(value)) for name, value in facts["versions"].items())
        machine = tuple((name, str(value)) for name, value in facts["machine"].items())
        inputs = tuple((name, str(value)) for name, value in self.inputs.items())
        return Section(
            "How this was made",
            [
                Text(f"Written on {time.strftime('%Y-%m-%d %H:%M', time.gmtime())} UTC. To make it again:"),
                Commands((self.command,)),
                Table(("input", "value"), inputs),
                Table(("street", "drives judged", "names"), seeds),
                Table(("package", "version"), versions),
                Table(("machine", ""), machine),
                Text(
                    "No ground truth reaches the system: each car knows its GNSS fixes, the map and the spots that the "
                    "service has, and what its cameras see. Each street is surveyed once, from a known pose, before "
                    "the drives that are judged."
                ),
            ],
        )


def _where_time_goes(summary: Mapping[str, tuple[float, float]]) -> str:
    """The longest parts of a window's last frame, in words."""
    one_by_one = {stage: median for stage, (median, _) in summary.items() if stage != END_TO_END}
    beside = sum(one_by_one.get(stage, 0.0) for stage in _BESIDE_SEGMENTATION)
    for stage in _BESIDE_SEGMENTATION if beside <= one_by_one.get("segmentation", 0.0) else ("segmentation",):
        one_by_one.pop(stage, None)
    whole = sum(one_by_one.values())
    longest = sorted(one_by_one, key=lambda stage: -one_by_one[stage])[:4]
    parts = ", ".join(f"{stage} {one_by_one[stage] / whole:.0%}" for stage in longest)
    return f"Of {whole:.0f} ms, the medians of what runs one after the other: {parts}."


def command_line(parts: list[str]) -> str:
    """The command as one would type it."""
    return " ".join(shlex.quote(part) for part in ("autowaze", "evaluate", *parts))
