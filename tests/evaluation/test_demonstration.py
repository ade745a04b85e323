"""The demonstration's loop, on streets of four spots: simulate, survey, serve, drive, compare with the truth."""

from dataclasses import replace
from pathlib import Path

import pytest

from autowaze.evaluation.accuracy import SpotTruth
from autowaze.evaluation.demonstration.city import found_city, true_poses
from autowaze.evaluation.demonstration.crew import Crews
from autowaze.evaluation.demonstration.outcome import Outcome, compare_changes
from autowaze.evaluation.demonstration.performance import Performance
from autowaze.evaluation.demonstration.story import Story, tell
from autowaze.simulator.plan.street_plan import plan_street
from autowaze.simulator.street import build_street
from autowaze.vehicle.semantics.no_segmentation import NoSegmentation
from autowaze.world.parking import Occupancy, ParkingMap, SpotState
from autowaze.world.streets import StreetNetwork


def small_story() -> Story:
    return tell(
        rig={"name": "free", "fx": 280.0, "baseline_m": 0.54, "width": 480, "height": 172},
        ego={"fps": 4.0},
        effects={"motion_blur_ms": 0.0},
        length_m=40.0,
        layout="straight",
        rows=[{"side": side, "count": 2} for side in ("left", "right")],
        parking={"kinds": ["hatch", "suv"]},
        traffic={"oncoming": 0, "pedestrians": 0, "cyclists": 0, "crossing_pedestrians": 0},
        trees=0.0,
        clutter=0.0,
    )


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome, dict[str, tuple[int, int]]]:
    folder = tmp_path_factory.mktemp("demo")
    progress: dict[str, tuple[int, int]] = {}
    story = small_story()
    with Crews(len(story.surveys), lambda name, done, total: progress.update({name: (done, total)})) as crews:
        performance = Performance(story, folder, crews, NoSegmentation.name)
        city = performance.prepare()
        with performance.serve(city, port=0) as service:
            outcome = performance.drive(city, service)
    return folder, outcome, progress


def test_the_cars_find_the_free_spots_and_what_changed(
    played: tuple[Path, Outcome, dict[str, tuple[int, int]]],
) -> None:
    _, outcome, _ = played
    assert outcome.scores.total >= 10
    assert outcome.scores.accuracy >= 0.9
    assert (outcome.changes, outcome.changes_noticed) == (2, 2)
    assert sum(outcome.counts().values()) == 8
    for car in outcome.cars:
        assert car.localization.localized_fraction > 0.2
        assert car.report.refused == 0
        assert len(car.report.diff_bytes) == len(car.report.end_to_end_ms) + 1  # the last window ends with the drive
    metrics = outcome.metrics()
    assert metrics["diffs"] == sum(len(car.report.diff_bytes) for car in outcome.cars)
    assert metrics["bytes_per_km"] > 1000
    assert metrics["cloud_integration_ms_median"] > 0


def test_progress_is_told_to_the_end(played: tuple[Path, Outcome, dict[str, tuple[int, int]]]) -> None:
    _, _, progress = played
    assert set(progress) == {
        *("survey 1", "survey 2", "car 1", "car 2", "car 3"),
        *("survey 1, map", "survey 2, map"),
    }
    assert all(done == total > 10 for done, total in progress.values())


def test_the_city_has_both_streets_in_one_frame(played: tuple[Path, Outcome, dict[str, tuple[int, int]]]) -> None:
    folder, _, _ = played
    story = small_story()
    surveys = [folder / "drives" / name for name in ("survey-1", "survey-2")]
    city = found_city(surveys, story.georeference, folder)
    spots = ParkingMap.from_geojson(city.parking_map)
    assert spots.georeference == story.georeference
    assert len(spots) == 8
    network = StreetNetwork.from_geojson(city.streets, story.georeference)
    assert len(network.streets) == 6
    for name, survey in zip(city.names, surveys, strict=True):
        own = [spot for spot in spots.spots if spot.id.startswith(f"{name}-")]
        path = true_poses(survey, story.georeference)[:, :2, 3]
        assert len(own) == 4
        for spot in own:  # the car passes each spot of its own street at a lane's distance
            assert 2.0 < min(((path - spot.centre) ** 2).sum(axis=1)) ** 0.5 < 9.0


def test_by_the_last_drive_some_cars_have_left_and_others_have_come() -> None:
    story = tell(seed=5)
    before, after = story.first[0].description, story.later.description
    assert len(before.parking.vacant) == len(after.parking.vacant) == 5
    assert len(set(before.parking.vacant) & set(after.parking.vacant)) == 2
    assert after.ego.start_time - before.ego.start_time == 1200.0
    assert before.drive != after.drive


def test_cars_that_stay_are_the_same_cars() -> None:
    story = small_story()
    parked = [
        {
            car.bay.id: (car.thing.model, car.thing.tint, car.thing.T_map_thing.tolist())
            for car in build_street(d).parked
        }
        for d in (story.first[0].description, story.later.description)
    ]
    stayed = parked[0].keys() & parked[1].keys()
    assert len(stayed) == 2
    assert all(parked[0][bay] == parked[1][bay] for bay in stayed)
    bays = {bay.id for bay in plan_street(story.later.description).bays}
    assert bays - parked[1].keys() == set(story.later.description.parking.vacant)


def test_a_change_is_noticed_when_both_states_were_told_rightly() -> None:
    truth = [
        SpotTruth(name, occupied, True) for name, occupied in (("a", True), ("b", False), ("c", True), ("d", True))
    ]
    later = [replace(spot, occupied=not spot.occupied) for spot in truth[:3]] + [replace(truth[3], observable=False)]
    told = [SpotState(spot.spot_id, Occupancy.OCCUPIED if spot.occupied else Occupancy.VACANT) for spot in truth]
    told_later = [SpotState("a", Occupancy.VACANT), SpotState("b", Occupancy.UNKNOWN), *told[2:]]
    assert compare_changes((told, told_later), (truth, later)) == (3, 1)
