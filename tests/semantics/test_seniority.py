"""A vehicle that something divides in the image goes on as the track that it was."""

import numpy as np

from autowaze.vehicle.semantics.instance_depth import InstanceDepths
from autowaze.vehicle.semantics.seniority import prefer_elders
from autowaze.vehicle.semantics.sort import Sort
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections

CAMERA = StereoCamera(fx=720.0, fy=720.0, cx=620.0, cy=187.0, baseline_m=0.54, width=1242, height=375)
ALL = np.ones((2, 2), np.bool_)


def found(*boxes):
    n = len(boxes)
    box = np.array(boxes, np.float32).reshape(n, 4)
    return Detections(box, np.ones(n, np.uint8), np.ones(n, np.float32), np.zeros((n, 4, 4), np.bool_))


def at_depth(*z):
    depth = np.array(z)
    return InstanceDepths(depth, depth, depth - 0.3, depth + 0.3)


def after_a_pedestrian(*boxes, z=20.0):
    """Ids of boxes after six frames of the whole car, and two in which somebody stands before its middle."""
    sort = Sort(CAMERA)
    for _ in range(6):
        whole = sort.update(found((300, 170, 400, 240)), np.eye(4), at_depth(20.0)).id.tolist()
    for _ in range(2):
        sort.update(found((300, 170, 355, 240), (372, 170, 400, 240)), np.eye(4), at_depth(20.0, 20.0))
    ids = sort.update(found(*boxes), np.eye(4), at_depth(*[z] * len(boxes))).id.tolist()
    return whole[0], ids


def test_the_larger_part_is_the_car():
    car, ids = after_a_pedestrian((300, 180, 322, 240), (338, 170, 400, 240))
    assert ids[1] == car
    assert ids[0] != car


def test_a_car_farther_away_is_not_the_one_that_was_divided():
    car, ids = after_a_pedestrian((340, 170, 400, 240), z=45.0)
    assert ids != [car]


def test_the_elder_track_gets_the_whole_and_the_young_one_what_is_left():
    rows = np.array([0, 1])
    prefer_elders(rows, np.array([9, 2]), np.array([1.0, 5.0]), np.array([[0.2, 0.1], [0.8, 0.9]]), ALL)
    assert rows.tolist() == [1, 0]


def test_an_elder_track_without_a_detection_takes_the_vehicle_over():
    rows = np.array([1])
    prefer_elders(rows, np.array([9, 2]), np.array([5.0]), np.array([[0.8, 0.9]]), ALL[:1])
    assert rows.tolist() == [0]


def test_two_grown_tracks_side_by_side_keep_what_they_have():
    rows = np.array([0, 1])
    prefer_elders(rows, np.array([9, 6]), np.array([1.0, 5.0]), np.array([[0.2, 0.1], [0.8, 0.9]]), ALL)
    assert rows.tolist() == [0, 1]


def test_nothing_is_taken_that_depth_forbids_or_that_fits_the_elder_no_better():
    for fit, possible in (([[0.2, 0.1], [0.8, 0.9]], ~ALL), ([[0.7, 0.1], [0.8, 0.9]], ALL)):
        rows = np.array([0, 1])
        prefer_elders(rows, np.array([9, 2]), np.array([1.0, 5.0]), np.array(fit), possible)
        assert rows.tolist() == [0, 1]
