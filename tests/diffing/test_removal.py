"""Gone or only missed."""

import numpy as np

from autowaze.vehicle.diffing.removal import LookedFor, removed_features
from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.vehicle.diffing.visibility import Sight

SETTINGS = DiffSettings()


def street(parts: list[tuple[int, int, int, dict[Sight, int]]]) -> LookedFor:
    """Groups of (features, instance, frames matched, frames missed by sight), 5 m apart."""
    count = [n for n, *_ in parts]
    group = np.repeat(np.arange(len(parts)), count)
    position = np.zeros((len(group), 3))
    position[:, 0] = 5.0 * group
    position[:, 1] = 0.05 * np.arange(len(group)) % 0.9
    sights = np.array([[missed.get(s, 0.0) for s in Sight] for *_, missed in parts])
    return LookedFor(
        map_id=np.arange(1, len(group) + 1, dtype=np.uint64),
        position=position,
        instance_key=np.array([key for _, key, *_ in parts], dtype=np.uint64)[group],
        matched=np.array([float(matched) for _, _, matched, _ in parts])[group],
        sights=sights[group],
    )


HOUSES = [(5, 0, 10, {Sight.SURFACE: 3})] * 20


def removed_of_last_part(parts: list[tuple[int, int, int, dict[Sight, int]]]) -> np.ndarray:
    return removed_features(street(parts), SETTINGS)[-parts[-1][0] :]


def test_a_car_that_left_is_seen_through() -> None:
    assert removed_of_last_part([*HOUSES, (30, 77, 0, {Sight.THROUGH: 8})]).all()


def test_a_car_in_place_of_another_removes_the_other() -> None:
    """There is a surface again, but none of the old car's features is found on it."""
    assert removed_of_last_part([*HOUSES, (30, 77, 0, {Sight.SURFACE: 8})]).all()


def test_a_parked_car_of_which_every_third_feature_matches_stays_whole() -> None:
    seen = street([*HOUSES, (10, 77, 4, {Sight.SURFACE: 4}), (20, 77, 0, {Sight.SURFACE: 8})])
    seen.position[-20:] = np.repeat(seen.position[-30:-20], 2, axis=0)
    assert not removed_features(seen, SETTINGS).any()


def test_of_two_cars_under_one_id_the_one_that_left_goes() -> None:
    parts = [*HOUSES, (15, 77, 6, {Sight.SURFACE: 4}), (15, 77, 0, {Sight.THROUGH: 8})]
    assert removed_of_last_part(parts).all()
    assert not removed_features(street(parts), SETTINGS)[:-15].any()


def test_a_hidden_car_stays() -> None:
    assert not removed_of_last_part([*HOUSES, (30, 77, 0, {Sight.HIDDEN: 8})]).any()


def test_one_glance_is_too_little() -> None:
    assert not removed_of_last_part([*HOUSES, (30, 77, 0, {Sight.THROUGH: 2})]).any()


def test_corners_of_a_house_that_never_match_are_not_gone() -> None:
    assert not removed_of_last_part([*HOUSES, (6, 0, 0, {Sight.SURFACE: 10})]).any()


def test_a_bin_that_was_taken_away_is_gone_and_a_single_poor_corner_is_not() -> None:
    seen_through = {Sight.THROUGH: 8}
    assert removed_of_last_part([*HOUSES, (4, 0, 0, seen_through)]).all()
    assert not removed_of_last_part([*HOUSES, (1, 0, 0, seen_through)]).any()
    seen = street([*HOUSES, (5, 0, 9, {Sight.THROUGH: 1}), (2, 0, 0, seen_through)])
    seen.position[-2:] = seen.position[-7:-5]  # on a wall most of which is found
    assert not removed_features(seen, SETTINGS).any()
    seen = street([*HOUSES, (20, 77, 7, {Sight.SURFACE: 2}), (1, 77, 0, seen_through)])  # beside the rest of a car
    assert not removed_features(seen, SETTINGS).any()


def test_when_hardly_anything_matches_the_light_is_to_blame() -> None:
    dark = [(5, 0, 0, {Sight.SURFACE: 9})] * 20 + [(5, 0, 3, {Sight.SURFACE: 9})] * 3
    assert not removed_features(street([*dark, (30, 77, 0, {Sight.THROUGH: 8})]), SETTINGS).any()


def test_a_car_leaves_with_the_features_that_were_looked_for_too_seldom() -> None:
    parts = [*HOUSES, (20, 77, 0, {Sight.THROUGH: 8}), (5, 77, 0, {Sight.UNKNOWN: 1})]
    assert removed_of_last_part(parts).all()


def test_a_far_car_of_which_few_features_were_judged_does_not_leave_as_a_whole() -> None:
    assert not removed_of_last_part(
        [*HOUSES, (6, 77, 0, {Sight.SURFACE: 4}), (80, 77, 0, {Sight.SURFACE: 1})],
    ).any()


def test_the_last_features_of_a_car_that_shares_its_id_go_with_the_rest_of_it() -> None:
    """Too few in their cell to be judged by it, another car behind them, and more of the id stands than is gone."""
    parts = [*HOUSES, (40, 77, 6, {Sight.SURFACE: 4}), (8, 77, 0, {Sight.THROUGH: 8}), (1, 77, 0, {Sight.SURFACE: 8})]
    seen = street(parts)
    seen.position[-1] = seen.position[-2] + [0.6, 0.0, 0.0]
    removed = removed_features(seen, SETTINGS)
    assert removed[-9:].all()
    assert not removed[:-9].any()
