"""How right, how fast and how frugal the demonstration was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from autowaze.evaluation.accuracy import Confusion, SpotTruth
from autowaze.evaluation.demonstration.crew import CarReport
from autowaze.evaluation.localization import LocalizationErrors
from autowaze.world.parking import Occupancy, SpotState


@dataclass(frozen=True)
class CarOutcome:
    """One car against the truth.

    Attributes:
        scores: what the service told of its street right after its drive.
    """

    name: str
    street: str
    scores: Confusion
    localization: LocalizationErrors
    report: CarReport

    def metrics(self) -> dict[str, float]:
        """Flat names for reports."""
        return {**self.scores.metrics(), **self.localization.metrics(), **self.report.metrics}


@dataclass(frozen=True)
class Outcome:
    """All cars.

    Attributes:
        changes: how many spots that the later car could see had turned free or taken since the first one.
        changes_noticed: how many of those the service told rightly both times.
        stages_ms: median time of each stage of the service.
        final: what the service told of all spots in the end.
    """

    cars: tuple[CarOutcome, ...]
    changes: int
    changes_noticed: int
    stages_ms: Mapping[str, float]
    final: Sequence[SpotState]

    @property
    def scores(self) -> Confusion:
        """Of all cars together."""
        return sum((car.scores for car in self.cars), Confusion())

    def counts(self) -> dict[Occupancy, int]:
        """How many spots are in each state in the end."""
        return {state: sum(s.occupancy is state for s in self.final) for state in Occupancy}

    def metrics(self) -> dict[str, float]:
        """Flat names for reports: of all cars together."""
        diff_bytes = np.concatenate([car.report.diff_bytes for car in self.cars])
        end_to_end = np.concatenate([car.report.end_to_end_ms for car in self.cars])
        return {
            **self.scores.metrics(),
            "changes": float(self.changes),
            "changes_noticed": float(self.changes_noticed),
            "diffs": float(len(diff_bytes)),
            "diff_bytes_median": float(np.median(diff_bytes)),
            "diff_bytes_max": float(diff_bytes.max()),
            "bytes_per_km": 1000.0 * float(diff_bytes.sum()) / sum(car.report.distance_m for car in self.cars),
            "end_to_end_ms_median": float(np.median(end_to_end)),
            **{f"cloud_{stage.replace(' ', '_')}_ms_median": ms for stage, ms in self.stages_ms.items()},
        }


def compare_changes(
    told: tuple[Sequence[SpotState], Sequence[SpotState]], true: tuple[Sequence[SpotTruth], Sequence[SpotTruth]]
) -> tuple[int, int]:
    """How many spots changed between two drives that could see them, and how many were told rightly both times."""
    before, after = ({spot.spot_id: spot for spot in truth if spot.observable} for truth in true)
    changed = [name for name in before if name in after and before[name].occupied != after[name].occupied]
    noticed = changed
    for states, truth in zip(told, (before, after), strict=True):
        said = {state.spot_id: state.occupancy for state in states}
        noticed = [name for name in noticed if said[name] is _truly(truth[name])]
    return len(changed), len(noticed)


def _truly(spot: SpotTruth) -> Occupancy:
    return Occupancy.OCCUPIED if spot.occupied else Occupancy.VACANT
