"""Parked vehicles that left the view are known again where they stand, or not at all."""

import numpy as np
import pytest

from autowaze.vehicle.semantics.gallery import Gallery
from autowaze.vehicle.semantics.instance_depth import InstanceDepths
from autowaze.vehicle.semantics.sort import Sort
from autowaze.vehicle.semantics.whereabouts import GroundPlane, Sightings, Whereabouts, look
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import heading_to_rotation, make_pose

CAMERA = StereoCamera(720.0, 720.0, 620.0, 187.0, 0.54, 1240, 375)
EYE_M = 1.65
ROW = np.column_stack([np.full(12, 8.0), np.delete(2.5 * np.arange(14), (4, 9))])  # two bays are empty


def parked_car(x, z, heading):
    """Box, uncut, and mean depth of the faces that are seen of a car in camera coordinates."""
    turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    corners = np.array([[0.9, 2.2], [0.9, -2.2], [-0.9, -2.2], [-0.9, 2.2]]) @ turn.T + [x, z]
    u = 620.0 + 720.0 * corners[:, 0] / corners[:, 1]
    box = [u.min(), 187.0 + 720.0 * (EYE_M - 1.5) / z, u.max(), 187.0 + 720.0 * EYE_M / corners[:, 1].min()]
    seen = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        outward = (a + b) / 2 - [x, z]
        if outward @ ((a + b) / 2) < 0:  # as many features per pixel wherever one looks
            t = np.linspace(0.02, 0.98, 25)[:, None]
            points = a + t * (b - a)
            columns = np.abs(np.gradient(points[:, 0] / points[:, 1]))
            seen.append((points[:, 1], columns))
    depth, weight = (np.concatenate(s) for s in zip(*seen, strict=True))
    return np.array(box), float(np.average(depth, weights=weight))


def at_depths(*z):
    d = np.array(z, np.float64)
    return InstanceDepths(d, d, d - 0.2, d + 0.2)


def seen_at(places):
    n = len(places)
    return Sightings(np.array(places, np.float64), np.tile(0.09 * np.eye(2), (n, 1, 1)), np.ones(n, np.bool_))


def gallery_of_the_row():
    gallery = Gallery()
    n = len(ROW)
    gallery.put(np.arange(1, n + 1, dtype=np.int32), ROW, np.tile(0.05 * np.eye(2), (n, 1, 1)), *np.ones((2, n), int))
    return gallery


NOBODY = np.zeros(0, np.int32)


@pytest.mark.parametrize("heading", [0.0, 0.5, 1.0, np.pi / 2])
@pytest.mark.parametrize("x", [-3.0, 0.0, 5.0])
def test_the_middle_of_a_car_is_found_from_wherever_it_is_seen(x, heading):
    box, depth = parked_car(x, 15.0, heading)
    labels = np.array([ClassLabel.CAR], np.uint8)
    sighting = look(CAMERA, GroundPlane(np.eye(4)), np.eye(4), box[None], labels, at_depths(depth))
    assert sighting.place[0] == pytest.approx([x, 15.0], abs=0.4)
    assert sighting.good[0]


def test_of_a_car_that_the_border_cuts_the_other_edge_tells():
    box, depth = parked_car(12.0, 14.0, 0.0)
    box[2] = 1240.0
    labels = np.array([ClassLabel.CAR], np.uint8)
    cut = look(CAMERA, GroundPlane(np.eye(4)), np.eye(4), box[None], labels, at_depths(depth))
    assert cut.place[0] == pytest.approx([12.0, 14.0], abs=1.0)
    whole, depth = parked_car(3.0, 14.0, 0.0)
    uncut = look(CAMERA, GroundPlane(np.eye(4)), np.eye(4), whole[None], labels, at_depths(depth))
    assert np.trace(cut.covariance[0]) > np.trace(uncut.covariance[0])


def test_a_car_whose_depth_nobody_knows_has_no_place():
    box, _ = parked_car(3.0, 14.0, 0.0)
    labels = np.array([ClassLabel.CAR], np.uint8)
    sighting = look(CAMERA, GroundPlane(np.eye(4)), np.eye(4), box[None], labels, InstanceDepths.unknown(1))
    whereabouts = Whereabouts()
    whereabouts.add(1)
    whereabouts.take_in(np.array([0]), sighting)
    assert not sighting.good[0]
    assert np.linalg.eigvalsh(whereabouts.places(np.array([0]))[1][0]).min() > 100.0


def test_a_row_seen_again_tells_how_far_the_odometry_has_drifted():
    gallery, drift = gallery_of_the_row(), np.array([-0.6, 0.9])
    for _ in range(25):
        gallery.correct_drift(seen_at(ROW[:8] - drift))
    assert gallery.recognise(seen_at(ROW[8:] - drift), NOBODY).tolist() == [9, 10, 11, 12]


def test_nothing_is_known_again_before_the_drift_is_known():
    assert gallery_of_the_row().recognise(seen_at(ROW), NOBODY).tolist() == [0] * len(ROW)


def test_a_vehicle_between_two_places_is_neither():
    gallery = gallery_of_the_row()
    for _ in range(25):
        gallery.correct_drift(seen_at(ROW[:8]))
    assert gallery.recognise(seen_at([(ROW[10] + ROW[11]) / 2]), NOBODY).tolist() == [0]


def test_who_is_in_view_is_not_known_again():
    gallery = gallery_of_the_row()
    for _ in range(25):
        gallery.correct_drift(seen_at(ROW[:8]))
    assert gallery.recognise(seen_at(ROW[8:]), np.array([10], np.int32)).tolist() == [9, 0, 11, 12]


def test_a_place_taken_anew_counts_once_and_two_cars_seen_together_are_two():
    gallery, covariance = Gallery(), 0.05 * np.eye(2)[None]
    put = [np.array([n], np.int32) for n in (1, 2, 3)]
    gallery.put(put[0], np.array([[0.0, 0.0]]), covariance, np.array([1]), np.array([10]))
    gallery.put(put[1], np.array([[0.3, 0.0]]), covariance, np.array([20]), np.array([30]))
    assert len(gallery) == 1
    gallery.put(put[2], np.array([[0.6, 0.0]]), covariance, np.array([25]), np.array([31]))
    assert len(gallery) == 2


def test_the_gallery_does_not_grow_on_an_endless_drive():
    gallery = Gallery()
    for frame in range(0, 5000, 5):
        gallery.put(
            np.array([frame + 1], np.int32), np.array([[0.0, frame]]), np.eye(2)[None] / 20, *np.full((2, 1), frame)
        )
    assert len(gallery) <= 150
    gallery.forget(20_000)
    assert len(gallery) == 0


def drive_past(sort, cars):
    """Ids (car: last id) of parked cars by a street that is driven 36 m north."""
    ids = {}
    for k in range(36):
        T = make_pose(heading_to_rotation(0.0), np.array([0.0, 1.0 * k, 0.0]))
        found, depths, who = [], [], []
        for car, (x, z) in enumerate(cars):
            if 4.0 < z - k < 25.0:
                box, depth = parked_car(x, z - k, 0.0)
                box = np.clip(box, 0, [1240, 375, 1240, 375])
                if box[2] - box[0] > 5:
                    found.append(box)
                    depths.append(depth)
                    who.append(car)
        n = len(found)
        detections = Detections(
            np.array(found, np.float32).reshape(n, 4),
            np.ones(n, np.uint8),
            np.ones(n, np.float32),
            np.zeros((n, 4, 4), bool),
        )
        ids.update(zip(who, sort.update(detections, T, at_depths(*depths)).id.tolist(), strict=True))
    return ids


def test_cars_of_a_street_that_is_driven_twice_get_their_ids_back():
    sort, cars = Sort(CAMERA), [(4.0, 12.0), (-4.0, 15.0), (4.0, 18.5), (4.0, 24.5), (-4.0, 27.0), (4.0, 33.0)]
    first, again = drive_past(sort, cars), drive_past(sort, cars)
    assert len(set(first.values())) == len(cars)
    assert [again[car] for car in (3, 4, 5)] == [first[car] for car in (3, 4, 5)]
