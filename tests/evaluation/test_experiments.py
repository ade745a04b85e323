"""Experiments from end to end on a street of four spots: rendered, driven, gone on with, judged, reported."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from autowaze.evaluation.demonstration import crew
from autowaze.evaluation.experiments.findings import Findings, find, sent_metrics, unchanged_bytes_per_km
from autowaze.evaluation.experiments.laboratory import Laboratory, run_series
from autowaze.evaluation.experiments.passage import SUMMARY, Passage
from autowaze.evaluation.experiments.plan import Experiment, PlannedDrive, Series, full_experiments, quick_experiments
from autowaze.evaluation.experiments.variants import METHODS, OFFSETS
from autowaze.evaluation.experiments.whole_report import Report
from autowaze.simulator import load_description
from autowaze.world.errors import AutowazeError
from autowaze.world.wire import decode_diff


def small_experiment() -> Experiment:
    drives = []
    for number in range(2):
        description = load_description(
            "town-a",
            drive=90 + number,
            rig={"name": "free", "fx": 280.0, "baseline_m": 0.54, "width": 480, "height": 172},
            ego={"fps": 4.0, "speed_kmh": 24.0, "start_time": 1.7e9 + 7200.0 * number},
            effects={"motion_blur_ms": 0.0},
            length_m=40.0,
            rows=[{"side": side, "count": 2} for side in ("left", "right")],
            parking={"occupancy": 0.5},
            traffic={"oncoming": 0, "pedestrians": 0, "cyclists": 0, "crossing_pedestrians": 0},
            trees=0.0,
            clutter=0.0,
        )
        drives.append(PlannedDrive(f"small-{number}", number, description))
    survey = drives[0].description
    again = survey.model_copy(
        update={"drive": 99, "parking": survey.parking.model_copy(update={"drive": survey.drive})}
    )
    return Experiment(
        "town", "A small street", (Series("small", tuple(drives), PlannedDrive("small-unchanged", 9, again)),)
    )


class Listener:
    """Hears what a process of the pool would tell."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def put(self, news: tuple[str, int, int]) -> None:
        self.heard.append(news[0])


def driven_here(laboratory: Laboratory, experiment: Experiment) -> list[str]:
    """Drive an experiment without a process of its own; what was told."""
    listener = Listener()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(crew, "_told", listener, raising=False)
        run_series(laboratory, experiment.series[0])
    return listener.heard


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Laboratory, Experiment, list[str]]:
    laboratory, experiment = Laboratory(tmp_path_factory.mktemp("cache"), "none"), small_experiment()
    return laboratory, experiment, driven_here(laboratory, experiment)


@pytest.fixture(scope="module")
def found(driven: tuple[Laboratory, Experiment, list[str]]) -> Findings:
    laboratory, experiment, _ = driven
    series = laboratory.driven(experiment.series[0])
    assert series is not None
    return find("town", experiment.title, 1, [series], True, lambda variants, title: [*variants, OFFSETS[-1]])


def test_every_method_answers_for_the_spots_in_sight(found: Findings) -> None:
    scores = found.scores(METHODS)
    assert list(scores) == [variant.name for variant in METHODS]
    assert {s.spots for s in scores.values()} == {4}
    assert {s.vacant for s in scores.values()} == {2}
    assert scores["fused"].accuracy.value >= 0.75
    assert all(s.unseen_vacant == 0 for s in scores.values())


def test_a_car_that_is_off_moves_what_it_tells(found: Findings) -> None:
    series = found.series[0]
    straight, moved = (
        [decode_diff(m) for m in variant.messages(series.passages[0], series.spots, 0)]
        for variant in (METHODS[-1], OFFSETS[-1])
    )
    for one, other in zip(straight, moved, strict=True):
        shifts = other.trajectory.position - one.trajectory.position
        assert np.linalg.norm(shifts, axis=1) == pytest.approx(1.5, abs=0.02)
        assert len(other.new) == len(one.new)


def test_the_whole_map_costs_far_more_than_the_diffs(found: Findings) -> None:
    sent = sent_metrics(found.series)
    assert sent["full_map_bytes_per_km"] > 5 * sent["bytes_per_km"] > 0
    whole = [decode_diff(m) for m in found.series[0].passages[0].full_map]
    assert sum(len(diff.new) for diff in whole) > 1000
    assert not any(diff.new.label.any() for diff in whole)


def test_a_street_in_which_nothing_has_changed_costs_little(found: Findings) -> None:
    of_street = unchanged_bytes_per_km(found.series)
    assert list(of_street) == ["small"]
    assert 0 < of_street["small"] < sent_metrics(found.series)["bytes_per_km"]
    passage = found.series[0].unchanged
    assert passage is not None
    assert sum(len(diff.new) for diff in passage.diffs) == 0
    assert found.drives == 1  # it is not judged
    assert found.metrics()["town, nothing changed"] == {"small_bytes_per_km": of_street["small"]}


def test_a_second_run_drives_nothing(driven: tuple[Laboratory, Experiment, list[str]]) -> None:
    laboratory, experiment, told = driven
    assert {"small-0, rendering", "small-1, driving"} <= set(told)
    assert driven_here(laboratory, experiment) == ["small-0", "small-unchanged", "small-1"]
    assert not (laboratory.place(experiment.judged[0]) / "left").exists()  # the disk is not filled with images


def test_a_run_of_another_model_does_not_count(driven: tuple[Laboratory, Experiment, list[str]]) -> None:
    laboratory, experiment, _ = driven
    folder, made_with = laboratory.run_folder(experiment.judged[0]), laboratory.made_with(experiment.judged[0])
    assert Passage.load(folder, made_with) is not None
    assert Passage.load(folder, made_with | {"model": "another"}) is None


def test_a_spoilt_run_is_named(driven: tuple[Laboratory, Experiment, list[str]], tmp_path: Path) -> None:
    laboratory, experiment, _ = driven
    shutil.copytree(laboratory.run_folder(experiment.judged[0]), tmp_path / "run")
    (tmp_path / "run" / SUMMARY).write_text("{}")
    with pytest.raises(AutowazeError, match="remove the folder"):
        Passage.load(tmp_path / "run", {})


def test_the_report_stands_for_itself(found: Findings, tmp_path: Path) -> None:
    whole = Report({"seed": 0}, "autowaze evaluate all -o here")
    whole.add_experiment(found)
    whole.add_comparisons({"town": found})
    whole.write(tmp_path)
    page, text = (tmp_path / "report.html").read_text(), (tmp_path / "report.md").read_text()
    assert "http" not in page.replace("http-equiv", "")  # nothing is fetched
    assert page.count("data:image/png;base64,") == len(list((tmp_path / "images").glob("*.png")))
    assert "| small | " in text.split("nothing has changed")[1]
    assert "| 0.89" not in text.split("## ")[1].splitlines()[0]
    assert "0.87 / 0.91 / 0.89" in text
    results = json.loads((tmp_path / "results.json").read_text())["results"]
    assert results["town, fused"]["spots"] == 4


def test_plans_share_their_first_drives() -> None:
    quick, full = quick_experiments(), full_experiments()
    assert [len(one.judged) for one in full] == [50, 20]
    for few, all_ in zip(quick, full, strict=True):
        by_street = {series.street: series for series in all_.series}
        for series in few.series:
            assert series.drives == by_street[series.street].drives[: len(series.drives)]
    assert not any(series.unchanged for one in quick for series in one.series)
    for series in (series for one in full for series in one.series):
        assert series.unchanged is not None
        survey, again = series.drives[0].description, series.unchanged.description
        assert again.parking == survey.parking.model_copy(update={"drive": survey.drive})
        assert again.ego.start_time > survey.ego.start_time
    names = [drive.name for one in full for series in one.series for drive in series.to_drive]
    assert len(set(names)) == len(names)
    other = quick_experiments(seed=1)[0].series[0].drives[1]
    assert other.description != quick[0].series[0].drives[1].description
    assert dataclasses.replace(other, name="") != other
