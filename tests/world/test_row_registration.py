"""A drive that drifts against the parking map, and what the vehicles parked along it show of that."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from autowaze.world.row_registration import MapShift, ParkedBoxes, shifts_along

FRAMES = 120
PATH = np.column_stack([np.zeros(FRAMES), np.arange(FRAMES, dtype=float)])
"""A metre north each frame."""
START = MapShift.at_start(0.05)


def _spots(pitch_m: float) -> NDArray[np.float64]:
    """Both sides of the road, from its tenth metre on."""
    along = np.arange(10.0, 115.0, pitch_m)
    return np.vstack([np.column_stack([np.full(len(along), side), along]) for side in (-7.0, 7.0)])


def _mapped(spots: NDArray[np.float64], drift: NDArray[np.float64], heading: float, seed: int) -> ParkedBoxes:
    """Cars in two thirds of the spots, some badly parked, a few elsewhere, mapped by a drive with this drift (F, 2)."""
    rng = np.random.default_rng(seed)
    cars = spots[rng.random(len(spots)) < 0.66]
    along, across = np.array([np.sin(heading), np.cos(heading)]), np.array([np.cos(heading), -np.sin(heading)])
    cars = cars + rng.normal(0, 0.35, (len(cars), 1)) * along + rng.normal(0, 0.2, (len(cars), 1)) * across
    cars = np.vstack([cars, np.column_stack([rng.uniform(-5, 5, 6), rng.uniform(10, 110, 6)])])
    passed = np.clip(np.rint(cars[:, 1]).astype(int), 0, FRAMES - 1)
    return ParkedBoxes(cars + drift[passed], np.full(len(cars), heading), np.full(len(cars), 60), passed)


@pytest.mark.parametrize(("pitch_m", "heading"), [(2.5, np.pi / 2), (6.1, 0.0)])
@pytest.mark.parametrize("seed", range(3))
def test_a_drift_of_a_per_cent_is_found(pitch_m: float, heading: float, seed: int) -> None:
    drift = 0.009 * PATH + np.column_stack([0.001 * PATH[:, 1], np.zeros(FRAMES)])
    spots = _spots(pitch_m)
    shifts, _ = shifts_along(PATH + drift, _mapped(spots, drift, heading, seed), spots, START)
    left = np.linalg.norm(drift + shifts, axis=1)
    assert np.linalg.norm(drift, axis=1).max() > 1.0
    assert np.median(left) < 0.15
    assert left.max() < 0.45


def test_a_shift_of_more_than_half_a_bay_is_followed_from_where_the_drive_began() -> None:
    drift, spots = 0.016 * PATH, _spots(2.5)
    shifts, _ = shifts_along(PATH + drift, _mapped(spots, drift, np.pi / 2, 4), spots, START)
    assert drift[-1, 1] > 1.8
    assert np.linalg.norm(drift + shifts, axis=1).max() < 0.3


def test_a_drive_that_passes_nobody_stays_as_it_is() -> None:
    nobody = ParkedBoxes(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64))
    assert np.array_equal(shifts_along(PATH, nobody, _spots(2.5), START)[0], np.zeros((FRAMES, 2)))


def test_cars_far_from_every_spot_say_nothing() -> None:
    cars = np.column_stack([np.full(20, 40.0), np.linspace(10, 100, 20)])
    boxes = ParkedBoxes(cars, np.zeros(20), np.full(20, 80), np.linspace(10, 100, 20).astype(np.int64))
    assert np.array_equal(shifts_along(PATH, boxes, _spots(2.5), START)[0], np.zeros((FRAMES, 2)))


def test_two_halves_of_a_way_end_where_the_whole_does() -> None:
    drift, spots = 0.012 * PATH, _spots(2.5)
    boxes = _mapped(spots, drift, np.pi / 2, 5)
    early = boxes.seen < FRAMES // 2
    halves = [
        ParkedBoxes(boxes.centre[m], boxes.heading[m], boxes.points[m], boxes.seen[m] - begin)
        for m, begin in ((early, 0), (~early, FRAMES // 2 - 1))
    ]
    path = PATH + drift
    _, between = shifts_along(path[: FRAMES // 2], halves[0], spots, START)
    shifts, _ = shifts_along(path[FRAMES // 2 - 1 :], halves[1], spots, between)
    assert np.linalg.norm(drift[-1] + shifts[-1]) < 0.25
