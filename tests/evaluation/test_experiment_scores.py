"""Scores with intervals, calibration and guards, on verdicts made by hand."""

import numpy as np
import pytest

from autowaze.evaluation.experiments.guards import Guard, breaches
from autowaze.evaluation.experiments.judging import Verdict, overlaps
from autowaze.evaluation.experiments.scores import calibrate, score
from autowaze.world.parking import Occupancy
from autowaze.world.vehicles import box_corners

VACANT, OCCUPIED, UNKNOWN = Occupancy.VACANT, Occupancy.OCCUPIED, Occupancy.UNKNOWN


def verdict(
    drive: str, occupied: bool, said: Occupancy, counts: bool = True, seen: bool = True, probability: float = 0.5
) -> Verdict:
    return Verdict(
        drive, "A", occupied, counts, seen, said, probability, "", occupied, 0.25 if occupied else np.nan, 0.0
    )


def test_scores_are_those_of_all_drives_together() -> None:
    found = score(
        [
            *(verdict("one", False, VACANT) for _ in range(8)),
            verdict("one", True, VACANT),
            verdict("two", False, UNKNOWN),
            verdict("two", False, OCCUPIED),
            *(verdict("two", True, OCCUPIED) for _ in range(9)),
        ]
    )
    assert found.precision.value == pytest.approx(8 / 9)
    assert found.recall.value == pytest.approx(8 / 10)
    assert found.accuracy.value == pytest.approx(17 / 20)
    assert (found.drives, found.spots, found.vacant) == (2, 20, 10)
    assert (found.false_vacant, found.false_occupied, found.unknown) == (1, 1, 1)
    assert (found.centre_median_m, found.own_car) == (0.25, 1.0)


def test_intervals_hold_the_value_and_shrink_with_drives() -> None:
    def drives(count: int) -> list[Verdict]:
        rng = np.random.default_rng(4)
        rows = []
        for number in range(count):
            wrong = rng.random(10) < 0.2
            rows += [verdict(str(number), False, OCCUPIED if w else VACANT) for w in wrong]
        return rows

    few, many = score(drives(5)).accuracy, score(drives(80)).accuracy
    assert few.low <= few.value <= few.high
    assert many.high - many.low < 0.5 * (few.high - few.low)
    assert many.low <= 0.8 <= many.high


def test_what_was_out_of_sight_counts_only_when_called_vacant() -> None:
    found = score(
        [
            verdict("one", True, UNKNOWN, counts=False, seen=False),
            verdict("one", True, VACANT, counts=False, seen=False),
            verdict("one", True, VACANT, counts=False, seen=True),
        ]
    )
    assert (found.spots, found.unseen_vacant, found.accuracy.value) == (0, 1, 1.0)


def test_calibration_of_honest_and_of_boastful_probabilities() -> None:
    honest = [verdict("one", number >= 8, VACANT, probability=0.8) for number in range(10)]
    boastful = [verdict("one", number >= 8, VACANT, probability=0.99) for number in range(10)]
    assert calibrate(honest).error == pytest.approx(0.0, abs=1e-12)
    assert calibrate(boastful).error == pytest.approx(0.19)
    assert calibrate(boastful).brier > calibrate(honest).brier == pytest.approx(0.16)


def test_a_guard_names_what_is_below_its_bound() -> None:
    guards = (Guard("town", "accuracy", at_least=0.9), Guard("town", "unseen", at_most=0))
    assert breaches({"town": {"accuracy": 0.95, "unseen": 0.0}}, guards) == []
    assert breaches({"town": {"accuracy": 0.85, "unseen": 0.0}}, guards) == [
        "town: accuracy is 0.85, must be at least 0.9"
    ]
    assert breaches({}, guards)[1] == "town: unseen was not measured"


def test_overlap_of_boxes() -> None:
    boxes = box_corners(np.array([[0.0, 0.0], [2.0, 0.0]]), np.full(2, 4.0), np.full(2, 2.0), np.full(2, np.pi / 2))
    assert overlaps(boxes, boxes) == pytest.approx(np.array([[1.0, 1 / 3], [1 / 3, 1.0]]))
    assert overlaps(boxes, boxes[:0]).shape == (2, 0)
