"""A car without a map whose odometry is wrong by two hundredths, on a street of which it knows the spots."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from street import Street

from autowaze.vehicle.diffing.registration import RowRegistration
from autowaze.world.displacement import displaced
from autowaze.world.map_diff import SemanticMapDiff

TOO_LONG = 1.018
STREET = Street(bays=True)
TAKEN = [0, 1, 3, 4, 5, 7, 8, 10, 11, 12, 14]


@pytest.fixture(scope="module")
def windows() -> list[tuple[SemanticMapDiff, SemanticMapDiff, NDArray[np.float64]]]:
    """Each window's diff as it should be, as odometry has it, and its path."""
    found = []
    for diff in STREET.drive(STREET.park(TAKEN)):
        path = diff.trajectory.position[:, :2]
        found.append((diff, displaced(diff, path, (TOO_LONG - 1.0) * path), TOO_LONG * path))
    return found


def _off(diff: SemanticMapDiff, true: SemanticMapDiff) -> float:
    if not len(true.new):
        return 0.0
    return float(np.linalg.norm((diff.new.position - true.new.position)[:, :2].mean(axis=0)))


def test_odometry_is_laid_onto_the_parking_map_as_the_car_goes(windows) -> None:
    rows = RowRegistration(STREET.parking_map)
    left = [_off(rows.registered(wrong, path, 0.02, False), true) for true, wrong, path in windows]
    before = [_off(wrong, true) for true, wrong, _ in windows]
    assert max(before) > 0.4
    assert max(left) < 0.5 * max(before)


def test_a_car_that_the_map_holds_tells_what_it_saw(windows) -> None:
    rows = RowRegistration(STREET.parking_map)
    assert all(rows.registered(wrong, path, 0.02, True) is wrong for _, wrong, path in windows)


def test_who_does_not_know_where_it_began_or_was_lost_is_not_moved(windows) -> None:
    unsure, lost = RowRegistration(STREET.parking_map), RowRegistration(STREET.parking_map)
    for _, wrong, path in windows:
        assert unsure.registered(wrong, path, 1.4, False) is wrong
        assert lost.registered(wrong, path, None, False) is wrong


def test_without_spots_nothing_is_moved(windows) -> None:
    assert all(RowRegistration(None).registered(wrong, path, 0.02, False) is wrong for _, wrong, path in windows)


def test_what_waited_is_told_where_the_last_window_was(windows) -> None:
    rows = RowRegistration(STREET.parking_map)
    for _, wrong, path in windows:
        moved = rows.registered(wrong, path, 0.02, False)
    again = rows.registered(wrong, path[-1:], np.inf, False)
    ends = [diff.trajectory.position[-1, :2] for diff in (moved, again)]
    assert np.linalg.norm(ends[0] - ends[1]) < 0.1
