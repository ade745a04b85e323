"""The confusion matrix: vacant is positive, and no answer is a wrong one."""

import json
from pathlib import Path

import pytest

from autowaze.evaluation.accuracy import Confusion, SpotTruth, confusion, read_truth
from autowaze.world.errors import AutowazeError
from autowaze.world.parking import Occupancy, SpotState

VACANT, OCCUPIED, UNKNOWN = Occupancy.VACANT, Occupancy.OCCUPIED, Occupancy.UNKNOWN


def score(*cases: tuple[Occupancy, bool, bool]) -> Confusion:
    """Cases of (answer, occupied, observable)."""
    states = [SpotState(str(i), answer) for i, (answer, _, _) in enumerate(cases)]
    truth = [SpotTruth(str(i), occupied, observable) for i, (_, occupied, observable) in enumerate(cases)]
    return confusion(states, truth)


def test_scores_of_a_street() -> None:
    counts = score(
        (VACANT, False, True), (VACANT, False, True), (VACANT, True, True), (OCCUPIED, False, True),
        (OCCUPIED, True, True), (OCCUPIED, True, True), (OCCUPIED, True, True), (OCCUPIED, True, True),
    )  # fmt: skip
    assert (counts.precision, counts.recall, counts.accuracy) == (2 / 3, 2 / 3, 6 / 8)


def test_no_answer_is_an_error_but_no_false_vacancy() -> None:
    counts = score((UNKNOWN, True, True), (UNKNOWN, False, True), (VACANT, False, True))
    assert (counts.precision, counts.recall, counts.accuracy) == (1.0, 1 / 2, 1 / 3)


def test_spots_out_of_view_do_not_count() -> None:
    counts = score((UNKNOWN, True, False), (VACANT, False, False), (OCCUPIED, True, True))
    assert (counts.total, counts.accuracy, counts.unobservable_vacant) == (1, 1.0, 1)


def test_truth_of_another_street_is_refused() -> None:
    with pytest.raises(AutowazeError, match="not on the parking map"):
        confusion([SpotState("A-1", VACANT)], [SpotTruth("B-1", True, True)])


def test_truth_comes_as_a_map_of_spots_or_inside_one(tmp_path: Path) -> None:
    spots = {"A-1": {"occupied": True, "observable": False}}
    for name, document in (("plain.json", spots), ("nested.json", {"frames": 3, "spots": spots})):
        (tmp_path / name).write_text(json.dumps(document))
        assert read_truth(tmp_path / name) == [SpotTruth("A-1", True, False)]
    (tmp_path / "wrong.json").write_text("[1, 2]")
    with pytest.raises(AutowazeError, match=r"wrong\.json"):
        read_truth(tmp_path / "wrong.json")
