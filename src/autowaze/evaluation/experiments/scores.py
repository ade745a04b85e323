"""Precision, recall and accuracy with intervals, calibration, boxes: figures made of verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.experiments.judging import Verdict, confusion_counts
from autowaze.world.parking import Occupancy

_RESAMPLES = 2000
_BINS = 10


@dataclass(frozen=True)
class Interval:
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3f} ({self.low:.3f} to {self.high:.3f})"


@dataclass(frozen=True)
class Scores:
    """What a variant reached on an experiment.

    Attributes:
        precision, recall, accuracy: vacant is positive (thesis, sec. 4.1.3), unknown is an error; intervals by
            bootstrap over drives.
        drives, spots, vacant: how many were judged, spots being counted once per drive.
        false_vacant: occupied spots called vacant; `false_occupied` the other way round.
        unknown: spots in view without an answer.
        unseen_vacant: spots called vacant that no drive so far had in view.
        own_car: share of the occupied spots that their own car marks.
        unboxed: occupied spots whose car has no box anywhere near.
        centre_median_m, centre_p95_m, heading_median_deg, heading_p95_deg: errors of vehicle boxes.
    """

    precision: Interval
    recall: Interval
    accuracy: Interval
    drives: int
    spots: int
    vacant: int
    false_vacant: int
    false_occupied: int
    unknown: int
    unseen_vacant: int
    own_car: float
    unboxed: int
    centre_median_m: float
    centre_p95_m: float
    heading_median_deg: float
    heading_p95_deg: float

    def metrics(self) -> dict[str, float]:
        """Flat names for reports."""
        out: dict[str, float] = {}
        for name, value in vars(self).items():
            if isinstance(value, Interval):
                out |= {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}
            else:
                out[name] = float(value)
        return out


def score(verdicts: Sequence[Verdict], seed: int = 0) -> Scores:
    """Figures over all drives together."""
    by_drive: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        by_drive.setdefault(verdict.drive, []).append(verdict)
    counts = np.array([confusion_counts(own) for own in by_drive.values()]).reshape(-1, 5)
    picks = np.random.default_rng(seed).integers(0, max(len(counts), 1), (_RESAMPLES, len(counts)))
    resampled = _ratios(counts[picks].sum(axis=1)) if len(counts) else np.ones((_RESAMPLES, 3))
    values = _ratios(counts.sum(axis=0)[None])[0]
    low, high = np.percentile(resampled, (2.5, 97.5), axis=0)
    precision, recall, accuracy = (Interval(*map(float, row)) for row in zip(values, low, high, strict=True))
    counted = [v for v in verdicts if v.counts]
    occupied = [v for v in counted if v.occupied]
    centre = np.array([v.centre_error_m for v in occupied])
    heading = np.degrees([v.heading_error_rad for v in occupied])
    boxed = np.isfinite(centre)
    return Scores(
        precision,
        recall,
        accuracy,
        drives=len(by_drive),
        spots=len(counted),
        vacant=len(counted) - len(occupied),
        false_vacant=sum(v.said is Occupancy.VACANT for v in occupied),
        false_occupied=sum(not v.occupied and v.said is Occupancy.OCCUPIED for v in counted),
        unknown=sum(v.said is Occupancy.UNKNOWN for v in counted),
        unseen_vacant=sum(not v.seen_before and v.said is Occupancy.VACANT for v in verdicts),
        own_car=float(np.mean([v.own_car for v in occupied])) if occupied else 1.0,
        unboxed=int((~boxed).sum()),
        centre_median_m=_quantile(centre[boxed], 50),
        centre_p95_m=_quantile(centre[boxed], 95),
        heading_median_deg=_quantile(heading[boxed], 50),
        heading_p95_deg=_quantile(heading[boxed], 95),
    )


@dataclass(frozen=True)
class Calibration:
    """Stated probabilities against what came true, in bins of the stated probability of being vacant.

    Attributes:
        stated, vacant: (K,) mean stated probability and share that was vacant, bins without a spot left out.
        spots: (K,) in each bin.
        error: mean of |stated - vacant|, weighted by spots (expected calibration error).
        brier: mean squared error of the probabilities.
    """

    stated: NDArray[np.float64]
    vacant: NDArray[np.float64]
    spots: NDArray[np.int64]
    error: float
    brier: float


def calibrate(verdicts: Sequence[Verdict]) -> Calibration:
    """Reliability of the probabilities of counted spots."""
    counted = [v for v in verdicts if v.counts]
    stated = np.array([v.probability_vacant for v in counted])
    vacant = np.array([not v.occupied for v in counted], dtype=np.float64)
    number = np.minimum((stated * _BINS).astype(np.int64), _BINS - 1)
    spots = np.bincount(number, minlength=_BINS)
    filled = spots > 0
    means = [np.bincount(number, column, _BINS)[filled] / spots[filled] for column in (stated, vacant)]
    gap = float(np.abs(means[0] - means[1]) @ spots[filled] / max(len(counted), 1))
    brier = float(np.mean((stated - vacant) ** 2)) if counted else 0.0
    return Calibration(means[0], means[1], spots[filled], gap, brier)


def _ratios(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Precision, recall, accuracy (N, 3) of rows as `confusion_counts` gives them; 1 where there is nothing to miss."""
    right, false, missed, occupied, _ = counts.T
    pairs = ((right, right + false), (right, right + missed), (right + occupied, counts.sum(axis=1)))
    with np.errstate(invalid="ignore"):
        return np.stack([np.where(whole > 0, part / np.maximum(whole, 1), 1.0) for part, whole in pairs], axis=1)


def _quantile(values: NDArray[np.float64], percent: float) -> float:
    return float(np.percentile(values, percent)) if len(values) else float("nan")
