"""What is news to the map."""

import numpy as np
import pytest

from autowaze.vehicle.diffing.novelty import Candidates, new_features, replaced_features
from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.world.identity import MAX_FEATURES_PER_DIFF
from autowaze.world.labels import ClassLabel

SETTINGS = DiffSettings()
NOBODY = np.zeros(0, np.int64)
NOTHING = np.zeros((0, 3))


def candidates(
    n: int,
    label: ClassLabel,
    instance: int = 0,
    found: int = 10,
    sigma: float = 0.1,
    deviation: float = 0.0,
    wanted: int | None = None,
    place_sigma: float | None = None,
    offset_px: float = 10.0,
) -> Candidates:
    rng = np.random.default_rng(n)
    return Candidates(
        landmark_id=np.arange(n),
        position=rng.uniform(-2, 2, (n, 3)),
        label=np.full(n, label, np.uint8),
        instance=np.full(n, instance),
        found=np.full(n, found),
        wanted=np.full(n, found if wanted is None else wanted),
        depth_sigma_m=np.full(n, sigma),
        position_sigma_m=np.full(n, sigma if place_sigma is None else place_sigma),
        offset_px=np.full(n, offset_px),
        deviation_m=np.full(n, deviation),
    )


def test_steady_features_are_new() -> None:
    assert len(new_features(candidates(50, ClassLabel.BACKGROUND), NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 50


def test_flickers_and_far_features_wait() -> None:
    once, far = candidates(9, ClassLabel.BACKGROUND, found=1), candidates(9, ClassLabel.BACKGROUND, sigma=2.0)
    assert len(new_features(once, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 0
    assert len(new_features(far, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 0


def test_far_features_are_news_once_several_views_tell_where_they_are() -> None:
    triangulated = candidates(9, ClassLabel.BACKGROUND, sigma=2.0, place_sigma=0.3)
    harmless = candidates(9, ClassLabel.BACKGROUND, sigma=5.0, place_sigma=1.0, offset_px=1.5)
    on_a_car = candidates(9, ClassLabel.CAR, 3, sigma=2.0, place_sigma=0.3, offset_px=1.5)
    for kind, number in ((triangulated, 9), (harmless, 9), (on_a_car, 0)):
        assert len(new_features(kind, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == number


def test_a_landmark_that_drifted_from_where_it_was_seen_is_no_feature() -> None:
    runaway = candidates(9, ClassLabel.BACKGROUND, deviation=1e6)
    assert len(new_features(runaway, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 0


def test_vehicles_have_a_place_in_the_fullest_diff() -> None:
    street, car = candidates(5000, ClassLabel.BACKGROUND), candidates(90, ClassLabel.CAR, 3)
    street.position *= 100
    both = Candidates(*(np.concatenate(pair) for pair in zip(vars(street).values(), vars(car).values(), strict=True)))
    chosen = new_features(both, NOBODY, NOTHING, NOTHING, DiffSettings(max_new_static=5000), 10_000_000)
    assert len(chosen) == MAX_FEATURES_PER_DIFF
    assert set(range(5000, 5090)) <= set(chosen.tolist())


def test_cars_are_passed_in_few_frames() -> None:
    assert len(new_features(candidates(9, ClassLabel.CAR, 3, found=2), NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 9


@pytest.mark.parametrize("label", [ClassLabel.CAR, ClassLabel.TWO_WHEELER])
def test_what_few_features_show_is_no_news(label: ClassLabel) -> None:
    assert len(new_features(candidates(3, label, 3), NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 0
    assert len(new_features(candidates(4, label, 3), NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 4


def test_moving_cars_and_people_are_no_map() -> None:
    car, person = candidates(9, ClassLabel.CAR, 3), candidates(9, ClassLabel.PERSON, 4)
    assert len(new_features(car, np.array([3]), NOTHING, NOTHING, SETTINGS, 50_000)) == 0
    assert len(new_features(person, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 0


def test_a_car_that_the_map_holds_is_no_news() -> None:
    car = candidates(40, ClassLabel.CAR, 3)
    stored = car.position + 0.05
    assert len(new_features(car, NOBODY, stored, NOTHING, SETTINGS, 50_000)) == 0
    assert len(new_features(car, NOBODY, stored + np.array([0, 8, 0]), NOTHING, SETTINGS, 50_000)) == 40


def test_half_a_car_that_the_map_holds_is_no_news_as_a_motorcycle() -> None:
    half = candidates(20, ClassLabel.TWO_WHEELER, 4)
    stored = half.position + 0.05
    assert len(new_features(half, NOBODY, stored, NOTHING, SETTINGS, 50_000)) == 0
    assert len(new_features(half, NOBODY, stored + np.array([0, 8, 0]), NOTHING, SETTINGS, 50_000)) == 20


def parked_car(corners: int, seen: int, along_m: float = 0.0, instance: int = 3) -> Candidates:
    """A car's side and rear with lamps, handles, wheels in places that a number says, and corners around them.

    Another number says which of the corners were seen, and how well.
    """
    shape, look = np.random.default_rng(corners), np.random.default_rng([corners, seen])
    side = shape.uniform([0.0, 0.0, 0.3], [4.4, 0.0, 1.5], (35, 3))
    rear = shape.uniform([0.0, 0.0, 0.3], [0.0, 1.8, 1.5], (20, 3))
    points = np.repeat(np.concatenate([side, rear]), 8, axis=0)
    points = (points + shape.normal(0.0, 0.05, points.shape))[look.random(len(points)) < 0.6]
    car = candidates(len(points), ClassLabel.CAR, instance, sigma=0.02)
    car.position = points + look.normal(0.0, 0.03, points.shape) + [along_m, 0.0, 0.0]
    return car


def sent(car: Candidates) -> np.ndarray:
    return car.position[new_features(car, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)]


def test_a_car_is_known_again_by_other_corners_of_it_but_not_another_car_in_its_place() -> None:
    stored = sent(parked_car(corners=1, seen=1))
    assert len(stored) == SETTINGS.max_per_instance
    for again in range(2, 6):
        assert len(new_features(parked_car(1, again), NOBODY, stored, NOTHING, SETTINGS, 50_000)) == 0
    for other, along_m in ((2, 0.5), (3, -0.5), (4, 1.0), (5, -1.0)):
        car = parked_car(other, 9, along_m)
        assert len(new_features(car, NOBODY, stored, NOTHING, SETTINGS, 50_000)) == SETTINGS.max_per_instance


def test_a_new_car_takes_the_place_of_the_old_one_but_not_of_its_neighbour() -> None:
    old, neighbour = sent(parked_car(1, 1)), sent(parked_car(2, 1, along_m=5.0))
    stored, key = np.concatenate([old, neighbour]), np.repeat(np.uint64([7, 8]), [len(old), len(neighbour)])
    new, known = parked_car(3, 1, along_m=0.3), parked_car(2, 2, along_m=5.0, instance=4)
    both = Candidates(*(np.concatenate(pair) for pair in zip(vars(new).values(), vars(known).values(), strict=True)))
    told = new_features(both, NOBODY, stored, NOTHING, SETTINGS, 50_000)
    assert set(both.instance[told]) == {3}
    gone = replaced_features(both, told, stored, key, SETTINGS)
    assert gone[key == 7].all()
    assert not gone[key == 8].any()
    assert not replaced_features(both, told[:0], stored, key, SETTINGS).any()


def test_a_glimpse_of_a_vehicle_waits() -> None:
    glimpse = candidates(SETTINGS.min_group - 1, ClassLabel.CAR, 3)
    assert len(new_features(glimpse, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 0


def test_where_the_map_has_features_more_of_them_are_no_news() -> None:
    wall = candidates(40, ClassLabel.BACKGROUND)
    assert len(new_features(wall, NOBODY, NOTHING, wall.position + 0.1, SETTINGS, 50_000)) == 0
    assert len(new_features(wall, NOBODY, NOTHING, wall.position + 9.0, SETTINGS, 50_000)) == 40


def test_a_tight_budget_keeps_the_best_seen_spread_in_space() -> None:
    crowd, lone = candidates(500, ClassLabel.BACKGROUND), candidates(1, ClassLabel.BACKGROUND, found=4)
    crowd.position *= 0.05
    lone.position += 30
    both = Candidates(*(np.concatenate(pair) for pair in zip(vars(crowd).values(), vars(lone).values(), strict=True)))
    chosen = new_features(both, NOBODY, NOTHING, NOTHING, SETTINGS, byte_budget=43 * 20)
    assert len(chosen) == 20
    assert 500 in chosen  # the only one of its place, though seen less often


def test_where_the_map_suffices_standing_features_are_no_news_but_vehicles_are() -> None:
    standing = candidates(50, ClassLabel.BACKGROUND, wanted=0)
    assert len(new_features(standing, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 0
    parked = candidates(50, ClassLabel.CAR, instance=4, wanted=0)
    assert len(new_features(parked, NOBODY, NOTHING, NOTHING, SETTINGS, 50_000)) == 50
