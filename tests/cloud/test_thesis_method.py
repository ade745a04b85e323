"""The thesis's way from points to vacant rectangles, step by step and as a whole."""

import json
from dataclasses import replace

import numpy as np
import pytest
from shapely import box
from street import Street

from autowaze.cloud.boxes import AVERAGE_LENGTH_M, boxes_of_average_size
from autowaze.cloud.grouping import VehicleGroups
from autowaze.cloud.instances import InstanceViews
from autowaze.cloud.occupancy import match_two_pass, vacant_rectangles
from autowaze.cloud.outliers import remove_outliers
from autowaze.cloud.service import CloudService
from autowaze.cloud.snapshot import pack, unpack
from autowaze.cloud.spots import SpotIndex
from autowaze.world.feature_map import MapFeatures
from autowaze.world.map_diff import InstanceSummaries
from autowaze.world.parking import Occupancy
from autowaze.world.wire import encode_diff

OCCUPIED = [0, 1, 2, 4, 5, 7, 8, 9, 12, 13]


def groups_of(*clouds):
    count = len(clouds)
    views = InstanceViews(
        np.arange(1, count + 1, dtype=np.uint64),
        np.ones(count, np.uint8),
        np.ones(count),
        np.zeros((count, 2)),
        np.ones(count, np.int64),
        np.ones(count),
    )
    return VehicleGroups(np.vstack(clouds), np.repeat(np.arange(count), [len(c) for c in clouds]), views)


def test_outliers_are_judged_within_their_own_group():
    rng = np.random.default_rng(0)
    car = rng.normal(0, 0.3, (40, 3))
    stray = np.array([[4.0, 0.0, 0.0]])
    neighbour = car + np.array([4.0, 0.0, 0.0])
    kept = remove_outliers(groups_of(np.vstack([car, stray]), neighbour))
    assert kept.sizes[1] >= 38
    assert not (kept.position[kept.group == 0, 0] > 3).any()


def test_average_box_stands_as_the_spot_next_to_it():
    street = Street(count=3, heading=0.7)
    spots = SpotIndex(street.parking_map)
    cloud = np.column_stack([street.centre(1) + np.random.default_rng(0).normal(0, 0.3, (30, 2)), np.ones(30)])
    boxes = boxes_of_average_size(groups_of(cloud), spots)
    assert boxes.length[0] == AVERAGE_LENGTH_M
    assert np.allclose(boxes.centre[0], street.centre(1), atol=0.3)
    assert np.isclose(boxes.heading[0], 0.7)
    assert boxes.polygons[0].intersection(spots.polygons[1]).area > 0.8 * boxes.polygons[0].area


def test_a_box_takes_the_spot_it_overlaps_most_and_only_that_one():
    spots = np.array([box(0, 0, 6, 2), box(6, 0, 12, 2)])
    match = match_two_pass(spots, np.array([box(4.8, 0, 9.3, 1.8)]))
    assert match.first.tolist() == [-1, 0]
    assert match.occupied.tolist() == [False, True]


def test_second_pass_culls_a_spot_that_a_drifted_box_covers():
    spots = np.array([box(0, 0, 6, 2), box(6, 0, 12, 2)])
    drifted = np.array([box(3.9, 0, 8.4, 1.8)])
    match = match_two_pass(spots, drifted)
    assert match.first.tolist() == [-1, 0]
    assert match.second.tolist() == [0, -1]
    assert match_two_pass(spots, drifted, second_pass=False).occupied.tolist() == [False, True]


def test_of_two_boxes_on_a_spot_the_one_with_more_overlap_is_associated():
    match = match_two_pass(np.array([box(0, 0, 6, 2)]), np.array([box(-2, 0, 2, 2), box(1, 0, 5, 2)]))
    assert match.first.tolist() == [1]


def test_no_box_or_no_spot_is_fine():
    none = np.array([], dtype=object)
    assert match_two_pass(np.array([box(0, 0, 1, 1)]), none).occupied.tolist() == [False]
    assert len(match_two_pass(none, np.array([box(0, 0, 1, 1)])).first) == 0


def test_rectangles_as_the_thesis_prints_them():
    assert vacant_rectangles(np.array([box(1, 2, 4.5, 8)])) == [{"x": 1.0, "y": 2.0, "width": 3.5, "height": 6.0}]
    assert vacant_rectangles(np.array([], dtype=object)) == []


@pytest.mark.parametrize("street", [Street(), Street(bays=True)], ids=["parallel", "bays"])
def test_a_drive_along_a_street_finds_every_vacant_spot(street):
    service = CloudService(street.parking_map, method="thesis")
    updates = [service.receive(encode_diff(diff)) for diff in street.drive(street.park(OCCUPIED))]
    taken = [i for i, state in enumerate(service.states) if state.occupancy is Occupancy.OCCUPIED]
    assert taken == OCCUPIED
    assert all(state.occupancy is not Occupancy.UNKNOWN for state in service.states)
    assert len(service.vacant()) == 5
    assert len(service.vehicle_boxes) == len(OCCUPIED)
    assert all(set(rectangle) == {"x", "y", "width", "height"} for rectangle in json.loads(updates[0].vacant_json))


def test_a_spot_that_nobody_looked_at_is_unknown():
    street = Street()
    service = CloudService(street.parking_map, method="thesis")
    service.integrate(street.drive(street.park(OCCUPIED))[0])
    states = [state.occupancy for state in service.states]
    assert states[3] is Occupancy.VACANT
    assert states[-1] is Occupancy.UNKNOWN
    assert service.states[-1].observed_at is None


@pytest.mark.parametrize("method", ["thesis", "fused"])
def test_vehicles_of_the_base_map_stand_where_it_has_them(method):
    street = Street(count=4)
    survey = CloudService(street.parking_map, "thesis")
    for diff in street.drive(street.park([1, 2]), start=1000.0):
        survey.integrate(diff)
    service = CloudService(street.parking_map, method, survey.feature_map)
    assert len(service.vehicle_boxes) >= 2
    # a car that finds nothing changed has no vehicle features to send: the same street with nobody new in it
    unchanged = [
        replace(diff, new=MapFeatures.empty(), instances=InstanceSummaries.empty(), map_version=service.map.version)
        for diff in street.drive(street.park([1, 2]), session=2, start=2000.0)
    ]
    for diff in unchanged:
        service.integrate(diff)
    assert [state.occupancy for state in service.states] == [
        *(Occupancy.VACANT, Occupancy.OCCUPIED, Occupancy.OCCUPIED, Occupancy.VACANT)
    ]
    again = CloudService(street.parking_map, method, survey.feature_map)
    assert again.restore(unpack(pack({"service": service.kept()}))["service"])
    assert again.vehicle_boxes.group.tolist() == service.vehicle_boxes.group.tolist()
