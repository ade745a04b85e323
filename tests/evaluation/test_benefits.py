"""Searching for a spot with and without knowing where one is free, on squared paper and on the thesis's car park."""

import json

import numpy as np
import pytest
import shapely
from shapely import LineString
from typer.testing import CliRunner

from autowaze.cli.evaluate import app
from autowaze.evaluation.benefits.costs import Rates
from autowaze.evaluation.benefits.lanes import ParkingLanes
from autowaze.evaluation.benefits.places import PlaceKind, draw_place
from autowaze.evaluation.benefits.study import SearchLengths, drawn_searches, search_places, thesis_metrics
from autowaze.evaluation.benefits.thesis_lot import LENGTH_M, WIDTH_M, thesis_lot
from autowaze.world.errors import AutowazeError


def fork(oneway=None):
    """Cars come from the south; 10 m on, a lane of 50 m goes west and one of 30 m east, a spot at each end."""
    lines = [LineString([(0, 0), (0, 10)]), LineString([(0, 10), (-50, 10)]), LineString([(0, 10), (30, 10)])]
    spots = [shapely.box(-41, 12, -39, 17), shapely.box(19, 12, 21, 17), shapely.box(-11, 12, -9, 17)]
    return ParkingLanes(lines, spots, np.array([[0.0, 0.0]]), oneway)


def test_the_thesis_arithmetic_follows_from_the_lanes():
    found = thesis_metrics(thesis_lot(), Rates())
    assert found["without_m"] == pytest.approx(195.0, abs=1e-6)
    assert found["with_m"] == pytest.approx(35.0, abs=1e-6)
    assert found["saved_fraction"] == pytest.approx(0.821, abs=0.001)
    assert found["without_s"] == pytest.approx(43.65, abs=0.05)
    assert found["with_s"] == pytest.approx(7.83, abs=0.005)
    assert (found["without_gal"], found["with_gal"]) == pytest.approx((0.0048, 0.00088), rel=0.02)
    assert (found["without_usd"], found["with_usd"]) == pytest.approx((0.0168, 0.0031), rel=0.02)


def test_the_thesis_lot_is_a_car_park():
    lot = thesis_lot()
    outline = shapely.box(0, 0, LENGTH_M, WIDTH_M)
    aisles = shapely.buffer(shapely.union_all(lot.lanes.graph.lines), 2.9, cap_style="flat")
    assert lot.vacant.sum() == 1
    assert all(outline.covers(spot) and spot.area == pytest.approx(11.25) for spot in lot.lanes.spots)
    assert shapely.union_all(lot.lanes.spots).area == pytest.approx(11.25 * len(lot.lanes))  # none on another
    assert shapely.intersection(aisles, shapely.union_all(lot.lanes.spots)).area < 0.2


def test_no_drawn_search_is_longer_than_the_unluckiest_and_some_are_as_long():
    lot = thesis_lot()
    drawn = drawn_searches(lot, 300, seed=5)
    longest, way = lot.lanes.longest_search(0, lot.vacant)
    assert drawn.without_m.max() == pytest.approx(longest)
    assert drawn.without_m.min() == pytest.approx(35.0)
    assert LineString(way).length == pytest.approx(longest)
    assert LineString(lot.lanes.way_to(0, int(np.flatnonzero(lot.vacant)[0]))).length == pytest.approx(35.0)


def test_who_searches_takes_either_lane_first_and_turns_back_at_dead_ends():
    lanes, rng = fork(), np.random.default_rng(1)
    vacant = np.array([False, True, False])
    assert lanes.to_spots_m(0).tolist() == pytest.approx([50, 30, 20])
    assert {round(lanes.search_m(0, vacant, rng), 6) for _ in range(40)} == {30.0, 10.0 + 50.0 + 50.0 + 20.0}
    assert lanes.longest_search(0, vacant)[0] == pytest.approx(130.0)


def test_a_search_ends_at_the_first_vacant_spot_that_it_passes():
    lanes, rng = fork(), np.random.default_rng(1)
    assert {round(lanes.search_m(0, np.array([True, False, True]), rng), 6) for _ in range(40)} == {20.0, 90.0 - 10.0}


def test_nothing_is_found_where_nothing_is_free_or_no_way_leads():
    rng = np.random.default_rng(1)
    assert fork().search_m(0, np.zeros(3, bool), rng) == np.inf
    against = fork(oneway=[False, False, True])
    assert np.isfinite(against.to_spots_m(0)).all()
    lines = [LineString([(0, 0), (0, 10)]), LineString([(30, 10), (0, 10)])]
    blocked = ParkingLanes(lines, [shapely.box(19, 12, 21, 17)], np.array([[0.0, 0.0]]), oneway=[False, True])
    assert blocked.to_spots_m(0)[0] == np.inf
    assert blocked.search_m(0, np.ones(1, bool), rng) == np.inf


def test_lanes_without_spots_and_spots_without_lanes_are_refused():
    with pytest.raises(AutowazeError, match="needs both"):
        ParkingLanes([LineString([(0, 0), (9, 0)])], [], np.zeros((1, 2)))
    with pytest.raises(AutowazeError, match="more than 50 m"):
        ParkingLanes([LineString([(0, 0), (9, 0)])], [shapely.box(90, 0, 92, 5)], np.zeros((1, 2)))


@pytest.mark.parametrize("kind", list(PlaceKind))
def test_who_knows_never_drives_farther(kind):
    found = search_places(kind, [0.6, 1.0], places=2, searches=10, seed=3)
    for lengths in found.values():
        assert np.isfinite(lengths.without_m).all()
        assert (lengths.with_m <= lengths.without_m + 1e-5).all()
    assert found[1.0].with_m.mean() > found[0.6].with_m.mean()
    if kind is not PlaceKind.STREET:  # along one street there is nothing to choose
        assert found[1.0].saved_fraction > 0.1


def test_every_spot_can_be_driven_to_from_every_entrance():
    for kind in PlaceKind:
        lanes = draw_place(kind, np.random.default_rng(8))
        assert all(np.isfinite(lanes.to_spots_m(entrance)).all() for entrance in range(len(lanes.entrances)))


def test_the_same_seed_gives_the_same_searches():
    one, other, third = (
        search_places(PlaceKind.BLOCK, [0.95], places=2, searches=5, seed=seed)[0.95] for seed in (1, 1, 2)
    )
    assert np.array_equal(one.without_m, other.without_m)
    assert not np.array_equal(one.without_m, third.without_m)


def test_the_interval_is_wider_where_places_differ():
    alike = SearchLengths(np.full(40, 100.0), np.full(40, 50.0), np.repeat(np.arange(8), 5))
    place = np.repeat(np.arange(8), 5)
    differing = SearchLengths(np.full(40, 100.0), 50.0 + 40.0 * (place % 2 - 0.5), place)
    assert alike.saved_interval(np.random.default_rng(0)) == pytest.approx((0.5, 0.5))
    low, high = differing.saved_interval(np.random.default_rng(0))
    assert low < 0.42 < 0.58 < high


def test_the_command_writes_figures_and_a_picture(tmp_path):
    out, picture = tmp_path / "benefits.json", tmp_path / "benefits.png"
    arguments = ["benefits", "--places", "2", "--searches", "2", "--occupancy", "1"]
    result = CliRunner().invoke(app, [*arguments, "--json", str(out), "--plot", str(picture)])
    assert result.exit_code == 0, result.output
    results = json.loads(out.read_text())["results"]
    assert results["thesis lot, unluckiest"]["without_m"] == pytest.approx(195.0)
    assert {"street 1.00", "block 1.00", "district 1.00", "lot 1.00"} <= set(results)
    assert picture.stat().st_size > 20_000
