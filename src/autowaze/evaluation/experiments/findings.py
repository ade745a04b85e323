"""What an experiment found: verdicts of every variant over all drives that have been driven."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from autowaze.evaluation.experiments.judging import DrivenSeries, JudgedSeries, Verdict, judge
from autowaze.evaluation.experiments.scores import Scores, score
from autowaze.evaluation.experiments.variants import ABLATIONS, METHODS, OFFSETS, Variant
from autowaze.evaluation.network import CONTENTS, content_bytes

Steps = Callable[[Sequence[Variant], str], Iterable[Variant]]
"""Wraps the variants that are judged one after the other, to show how far that has come."""


@dataclass
class Findings:
    """One experiment.

    Attributes:
        name, title: of the experiment.
        planned: how many drives it has; fewer may have been driven yet.
        series: what was driven.
        judged: by variant.
    """

    name: str
    title: str
    planned: int
    series: tuple[DrivenSeries, ...]
    judged: dict[str, tuple[JudgedSeries, ...]] = field(default_factory=dict)

    @property
    def drives(self) -> int:
        """How many were driven."""
        return sum(len(one.names) for one in self.series)

    def verdicts(self, variant: str) -> list[Verdict]:
        """All of one variant."""
        return [verdict for one in self.judged[variant] for verdict in one.verdicts]

    def scores(self, variants: Iterable[Variant]) -> dict[str, Scores]:
        """By variant, of those that were judged."""
        return {v.name: score(self.verdicts(v.name)) for v in variants if v.name in self.judged}

    def by_street(self, variant: str) -> dict[str, Scores]:
        """One variant street by street."""
        return {one.street: score(one.verdicts) for one in self.judged[variant]}

    def metrics(self) -> dict[str, dict[str, float]]:
        """Flat names for reports, by variant, and what was sent."""
        out = {f"{self.name}, {name}": score(self.verdicts(name)).metrics() for name in self.judged}
        driven, sent = driving_metrics(self.series), sent_metrics(self.series)
        out |= {f"{self.name}, driven": driven, f"{self.name}, sent": sent}
        unchanged = {f"{street}_bytes_per_km": size for street, size in unchanged_bytes_per_km(self.series).items()}
        return out | ({f"{self.name}, nothing changed": unchanged} if unchanged else {})


def find(name: str, title: str, planned: int, series: Sequence[DrivenSeries], is_quick: bool, steps: Steps) -> Findings:
    """Judge the methods, and unless it must be quick the ablations and maps that are off."""
    findings = Findings(name, title, planned, tuple(series))
    variants = METHODS if is_quick else (*METHODS, *ABLATIONS, *OFFSETS)
    every = tuple({variant.name: variant for variant in variants}.values())
    for variant in steps(every, title):
        findings.judged[variant.name] = tuple(judge(one, variant) for one in series)
    return findings


def sent_metrics(series: Sequence[DrivenSeries]) -> dict[str, float]:
    """Bytes that cars sent: per window of 5 s, per kilometre, by content; and what whole maps would have cost."""
    passages = [passage for one in series for passage in one.passages]
    messages = [message for passage in passages for message in passage.messages]
    if not messages:
        return {"diffs": 0.0}
    sizes = np.array([len(message) for message in messages])
    whole = np.array([size for passage in passages for size in passage.full_map_sizes])
    distance_m = sum(passage.metrics["distance_m"] for passage in passages)
    contents = np.array([list(content_bytes(message).values()) for message in messages]).mean(axis=0)
    return {
        "diffs": float(len(sizes)),
        "distance_m": distance_m,
        "diff_bytes_median": float(np.median(sizes)),
        "diff_bytes_p95": float(np.percentile(sizes, 95)),
        "diff_bytes_max": float(sizes.max()),
        "bytes_per_km": 1000.0 * float(sizes.sum()) / distance_m,
        "full_map_bytes_median": float(np.median(whole)),
        "full_map_bytes_per_km": 1000.0 * float(whole.sum()) / distance_m,
        **{f"{name}_bytes_per_diff": float(size) for name, size in zip(CONTENTS, contents, strict=True)},
    }


def unchanged_bytes_per_km(series: Sequence[DrivenSeries]) -> dict[str, float]:
    """Bytes that a drive sent per kilometre, by street in which nothing had changed since its survey."""
    passages = {one.street: one.unchanged for one in series if one.unchanged is not None}
    return {s: 1000.0 * sum(map(len, p.messages)) / p.metrics["distance_m"] for s, p in passages.items()}


def driving_metrics(series: Sequence[DrivenSeries]) -> dict[str, float]:
    """How well the cars knew their place: medians over drives of the medians and 95th percentiles of each."""
    passages = [passage for one in series for passage in one.passages]
    names = ("localized_fraction", "position_error_median_cm", "position_error_p95_cm")
    columns = {name: [p.metrics[name] for p in passages if name in p.metrics] for name in names}
    out = {name: float(np.median(values)) for name, values in columns.items() if values}
    return out | {"drives": float(len(passages))}
