"""Boxes that know the visible side, ground as evidence, a belief over time."""

from dataclasses import replace

import numpy as np
import pytest
from street import Car, Street
from test_thesis_method import groups_of

from autowaze.cloud.belief import Evidence, aged, believe, fade
from autowaze.cloud.grouping import split_in_space
from autowaze.cloud.instances import InstanceTable
from autowaze.cloud.merging import merge_boxes
from autowaze.cloud.methods import FUSED
from autowaze.cloud.rejoining import rejoin_parts
from autowaze.cloud.row_split import split_along_rows
from autowaze.cloud.service import CloudService
from autowaze.cloud.spots import SpotIndex
from autowaze.cloud.visible_side import boxes_from_visible_side
from autowaze.world.ground import CELL_M, GroundCells
from autowaze.world.identity import instance_keys
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import Occupancy
from autowaze.world.vehicles import VehicleBoxes
from autowaze.world.visible_side import fitted_boxes
from autowaze.world.wire import decode_map, encode_map

OCCUPIED = [0, 1, 2, 4, 5, 7, 8, 9, 12, 13]
STREETS = [Street(), Street(bays=True, heading=2.0)]
NAMES = ["parallel", "bays"]


def occupied(service):
    return [i for i, state in enumerate(service.states) if state.occupancy is Occupancy.OCCUPIED]


def vacant(service):
    return [i for i, state in enumerate(service.states) if state.occupancy is Occupancy.VACANT]


@pytest.mark.parametrize("street", STREETS, ids=NAMES)
def test_box_centres_lie_where_the_cars_stand(street):
    cars = street.park(OCCUPIED)
    service = CloudService(street.parking_map)
    for diff in street.drive(cars):
        service.integrate(diff)
    centres = service.vehicle_boxes.centre
    error = [np.linalg.norm(centres - [car.x, car.y], axis=1).min() for car in cars]
    assert np.median(error) < 0.4
    assert max(error) < 0.8


@pytest.mark.parametrize("street", STREETS, ids=NAMES)
def test_vehicles_of_a_base_map_stand_where_its_survey_saw_them(street):
    survey, cars = CloudService(street.parking_map), street.park(OCCUPIED)
    for diff in street.drive(cars):
        survey.integrate(diff)
    base_map = decode_map(encode_map(survey.map.as_base_map()))
    centres = CloudService(street.parking_map, base_map=base_map).vehicle_boxes.centre
    error = [np.linalg.norm(centres - [car.x, car.y], axis=1).min() for car in cars]
    assert np.median(error) < 0.4
    assert max(error) < 0.8


@pytest.mark.parametrize("street", STREETS, ids=NAMES)
@pytest.mark.parametrize("drift", [(0.0, 0.0), (0.4, 0.3), (-0.4, -0.3)], ids=["true", "ahead right", "behind left"])
def test_half_a_metre_of_drift_changes_no_decision(street, drift):
    service = CloudService(street.parking_map)
    for diff in street.drive(street.park(OCCUPIED), drift=drift):
        service.integrate(diff)
    assert occupied(service) == OCCUPIED
    assert set(vacant(service)) <= set(range(15)) - set(OCCUPIED)
    assert len(vacant(service)) >= 4


def test_a_vehicle_that_stands_in_the_lane_is_not_parked():
    street = Street(count=6)
    spot = street.centre(2)
    lane = spot - 2.6 * street.across
    service = CloudService(street.parking_map)
    for diff in street.drive([*street.park([0, 4]), Car(*lane, street.heading)]):
        service.integrate(diff)
    assert occupied(service) == [0, 4]
    assert len(service.vehicle_boxes) == 3


def test_newer_ground_makes_a_spot_vacant_again_and_older_ground_does_not():
    street = Street(count=4)
    before = street.drive(street.park([0, 1, 2]), session=1, start=1000.0)
    after = [replace(diff, new=diff.new[:0]) for diff in street.drive(street.park([0, 2]), session=2, start=1300.0)]
    for order in (before + after, after + before):
        service = CloudService(street.parking_map)
        for diff in order:
            service.integrate(diff)
        assert occupied(service) == [0, 2]
        assert vacant(service) == [1, 3]
        assert service.states[1].observed_at == max(diff.end for diff in after if diff.end < 1320)


def test_a_car_that_parks_later_takes_the_spot():
    street = Street(count=4)
    service = CloudService(street.parking_map)
    for diff in street.drive(street.park([0]), session=1) + street.drive(street.park([0, 1]), session=2, start=1200.0):
        service.integrate(diff)
    assert occupied(service) == [0, 1]


def test_without_ground_the_boxes_decide():
    street = STREETS[0]
    service = CloudService(street.parking_map, method=replace(FUSED, ground=False))
    for diff in street.drive(street.park(OCCUPIED)):
        service.integrate(diff)
    assert occupied(service) == OCCUPIED


def test_of_a_car_in_a_bay_the_end_at_the_street_shows_however_askew_it_is_seen():
    street = Street(bays=True)
    first = street.drive(street.park([4]))[1]
    askew = (street.along - 0.15 * street.across).astype(np.float32)  # on a bend, where bays ahead turn their backs
    diff = replace(first, instances=replace(first.instances, view_direction=np.tile(askew, (len(first.instances), 1))))
    table = InstanceTable()
    keys = instance_keys(diff.session, diff.instances.id)
    table.add(keys, diff)
    assert (table.views(keys).view_direction @ street.across > 0.3).all()


@pytest.mark.parametrize(("aside", "is_turned"), [(0.5, False), (6.0, True)], ids=["on the line", "in the row"])
def test_where_the_street_ahead_may_bend_a_car_is_on_the_side_from_which_it_is_seen(aside, is_turned):
    """No car is parked so near the straight line, 18 m ahead: the street bends, and may leave it on the left."""
    street = Street(bays=True)
    first = next(diff for diff in street.drive(street.park([4])) if len(diff.instances) and len(diff.new))
    place = first.trajectory.position[-1, :2] + [aside, 18.0]
    positions = first.new.position + np.append(place - first.new.position[:, :2].mean(axis=0), 0.0)
    view = np.tile(np.array([-0.2, 0.98], np.float32), (len(first.instances), 1))
    diff = replace(
        first,
        instances=replace(first.instances, view_direction=view),
        new=replace(first.new, position=positions),
        trajectory=replace(first.trajectory[-1:], heading=np.zeros(1, np.float32)),
    )
    table, keys = InstanceTable(), instance_keys(diff.session, diff.instances.id)
    table.add(keys, diff)
    assert ((table.views(keys).view_direction[:, 0] > 0) == is_turned).all()


def test_points_along_the_side_of_a_vehicle_do_not_hide_where_it_begins():
    along = np.linspace(0.0, 3.8, 100)
    points = np.column_stack([np.full(100, 0.0), along])
    table = fitted_boxes(
        points, np.zeros(1, np.int64), np.array([100]), np.array([[0.6, 0.8]]), np.array([[4.3, 1.8]]), np.zeros(1)
    )
    assert table[0, 1] - table[0, 2] / 2 < 0.35


def test_an_id_that_jumps_to_the_next_car_is_split():
    rng = np.random.default_rng(0)
    car = rng.uniform(-0.5, 0.5, (60, 3))
    parts = split_in_space(groups_of(np.vstack([car, car + np.array([2.5, 0.0, 0.0])]), car + np.array([9.0, 0, 0])))
    assert parts.sizes.tolist() == [60, 60, 60]
    assert parts.views.key.tolist() == [1, 1, 2]


@pytest.mark.parametrize("drift", [-0.5, 0.0, 0.5])
def test_an_id_on_two_cars_side_by_side_is_cut_between_them(drift):
    street = Street(bays=True)
    cars = street.park([3, 4])
    mouth = np.linspace(-0.85, 0.85, 18)[:, None] * street.along - 2.0 * street.across
    points = np.vstack([mouth + np.array([car.x, car.y]) for car in cars])
    points = np.column_stack([points + drift * street.along, np.zeros(len(points))])
    spots = SpotIndex(street.parking_map)
    assert split_along_rows(groups_of(points), spots).sizes.tolist() == [18, 18]
    assert split_along_rows(groups_of(points[:18], points[18:]), spots).sizes.tolist() == [18, 18]


@pytest.mark.parametrize(("pieces", "vehicles"), [([(-2.1, 0.4), (1.3, 2.1)], 1), ([(-2.1, 2.1), (3.9, 4.9)], 2)])
def test_a_gap_in_the_side_of_a_car_makes_no_second_one(pieces, vehicles):
    street = Street(count=6)
    along = np.concatenate([np.arange(first, last, 0.1) for first, last in pieces])[:, None] * street.along
    side = street.centre(2) - 0.9 * street.across
    groups = groups_of(np.column_stack([along + side, np.zeros(len(along))]), np.full((5, 3), 90.0))
    groups.views.view_direction[:] = street.across
    spots = SpotIndex(street.parking_map)
    parts = split_in_space(groups)
    wholes = rejoin_parts(parts, boxes_from_visible_side(parts, spots))
    assert len(parts) == 3
    assert len(wholes) == vehicles + 1
    assert wholes.sizes.sum() == parts.sizes.sum()
    assert wholes.views.key.tolist() == [1] * vehicles + [2]


def test_the_spot_pulls_a_parked_car_of_few_points_and_none_in_the_lane():
    street = Street(count=6)
    spots, points = SpotIndex(street.parking_map), np.linspace(-2.1, 2.1, 6)[:, None] * street.along
    parked, lane = street.centre(2) + 0.4 * street.along, street.centre(2) - 2.6 * street.across
    centre = {}
    for name, middle in (("parked", parked), ("lane", lane)):
        position = np.column_stack([points + middle, np.zeros(6)])
        centre[name] = boxes_from_visible_side(groups_of(position), spots).centre[0]
    assert 0.05 < (parked - centre["parked"]) @ street.along < 0.3
    assert np.linalg.norm(centre["lane"] - lane) < 0.05


def box_row(x, y, points, group, seen_at=0.0):
    one = np.ones(1)
    return VehicleBoxes(
        np.array([[x, y]]),
        one * 4.4,
        one * 1.8,
        one * 0.0,
        np.array([group], np.uint64),
        np.ones(1, np.uint8),
        one,
        np.array([points]),
        one * seen_at,
    )


def test_fragments_of_one_car_merge_and_neighbours_in_bays_do_not():
    fragments = [box_row(0, 0, 30, 5, 1.0), box_row(0.2, 0.6, 10, 9, 2.0), box_row(2.3, 0, 20, 7)]
    merged = merge_boxes(VehicleBoxes.concatenate(fragments))
    assert merged.group.tolist() == [5, 7]
    assert merged.points.tolist() == [40, 20]
    assert np.allclose(merged.centre[0], [0.05, 0.15])
    assert merged.seen_at[0] == 2.0


def test_the_newest_look_says_where_a_vehicle_stands():
    left_over, now = box_row(0.0, 0.0, 80, 1, seen_at=0.0), box_row(0.0, 1.4, 40, 2, seen_at=900.0)
    again = box_row(0.0, 1.2, 40, 3, seen_at=905.0)
    merged = merge_boxes(VehicleBoxes.concatenate([left_over, now, again]))
    assert merged.points.tolist() == [160]
    assert merged.centre[0] == pytest.approx([0.0, 1.3])


def test_belief_fades_to_even_odds():
    state = believe("A", [Evidence(0.0, 5.0, "car")])
    assert state.occupancy is Occupancy.OCCUPIED
    later = aged(state, 600.0)
    assert state.probability_vacant < later.probability_vacant < 0.5
    assert aged(state, 24 * 3600.0).occupancy is Occupancy.UNKNOWN
    assert np.isclose(fade(-3.0, 1e9), 0.0)
    assert np.isclose(fade(-3.0, 0.0), -3.0)


def test_evidence_counts_in_the_order_of_observation():
    old, new = Evidence(0.0, 5.0, "car"), Evidence(300.0, -5.0, "free")
    assert believe("A", [new, old]) == believe("A", [old, new])
    assert believe("A", [new, old]).occupancy is Occupancy.VACANT


def test_a_car_that_does_not_know_its_place_is_believed_less():
    street = Street(count=4)
    states = []
    for sigma in (0.05, 1.5):
        service = CloudService(street.parking_map)
        for diff in street.drive(street.park([0])):
            service.integrate(replace(diff, position_sigma_m=sigma))
        states.append(service.states[1])
    assert 0.5 < states[1].probability_vacant < states[0].probability_vacant


def test_nobody_looked_nothing_known():
    service = CloudService(Street().parking_map)
    service.integrate(SemanticMapDiff(1, 0, 0.0, 5.0))
    assert {state.occupancy for state in service.states} == {Occupancy.UNKNOWN}


@pytest.mark.parametrize(
    ("free_m", "obstacle_m", "said"), [(3.1, 1.9, Occupancy.VACANT), (1.1, 1.1, Occupancy.OCCUPIED)]
)
def test_less_than_a_vehicle_in_a_bay_that_was_seen_whole_is_none(free_m, obstacle_m, said):
    """From the lane on, free ground and then obstacles: of a bay that was half seen the rest may be a vehicle, too."""
    street = Street(count=3, heading=0.0, bays=True)
    x, y = np.meshgrid(np.arange(0.0, 10.0, CELL_M), np.arange(0.0, 20.0, CELL_M))
    into = x.ravel() - (street.centre(1)[0] - 2.5)
    rows = np.flatnonzero((into > -1.0) & (into < free_m + obstacle_m))
    ix, iy = (np.floor(a.ravel()[rows] / CELL_M).astype(np.int32) for a in (x, y))
    free, obstacle = (a.astype(np.uint16) for a in (9 * (into[rows] <= free_m), 9 * (into[rows] > free_m)))
    service = CloudService(street.parking_map)
    service.integrate(SemanticMapDiff(1, 0, 0.0, 5.0, ground=GroundCells(ix, iy, free, obstacle)))
    assert service.states[1].occupancy is said
