"""Parked or moving, on points whose motion is known."""

import numpy as np
import pytest
from scene import CAMERA, camera_at, car_side, random_descriptors, see

from autowaze.vehicle.semantics.motion import MotionClassifier
from autowaze.vehicle.semantics.rematching import match_within_instances
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.labels import ClassLabel

SHORT = StereoCamera(528.0, 528.0, 639.5, 359.5, 0.12, 1280, 720)


def drive(
    points_at, frames=20, speed=8.0, n=30, label=ClassLabel.CAR, visible=None, seed=0, camera=CAMERA, known_again=True
):
    """Motions, frame by frame, of a drive north past an object whose points at time t are `points_at(t)`."""
    rng = np.random.default_rng(seed)
    descriptors = random_descriptors(rng, n)
    classifier = MotionClassifier(camera)
    history = []
    for k in range(frames):
        t = 0.1 * k
        points = points_at(t)
        rows = np.arange(n) if visible is None else visible(k, points)
        if not known_again:
            descriptors = random_descriptors(rng, n)
        here = camera_at(0.0, speed * t)
        features = see(points[rows], here, descriptors[rows], 7, noise=rng, label=label, camera=camera)
        history.append(classifier.update(features, camera_at(0.0, speed * t), t))
    return history


@pytest.mark.parametrize("distance", [10.0, 20.0, 30.0, 40.0])
def test_a_parked_car_is_parked_at_any_distance(distance):
    side = car_side(np.random.default_rng(1), 30, 3.0, distance)
    history = drive(lambda t: side, frames=10)
    assert not any(m.moving.any() for m in history)
    assert np.array_equal(history[-1].velocity, np.zeros((1, 2)))


def test_the_part_seen_may_slide_along_a_parked_car():
    side = car_side(np.random.default_rng(2), 60, 3.0, 15.0)

    def visible(k, points):  # the nearest two metres of it, one metre later
        start = 15.0 + 0.2 * k
        return np.flatnonzero((points[:, 1] >= start) & (points[:, 1] < start + 2.0))

    history = drive(lambda t: side, frames=12, n=60, visible=visible)
    shift = history[-1].position[0] - history[0].position[0]
    assert shift[1] > 1.0
    assert not any(m.moving.any() for m in history)


def test_an_oncoming_car_moves_with_its_speed():
    side = car_side(np.random.default_rng(3), 30, -3.0, 40.0)
    last = drive(lambda t: side + np.array([0.0, -10.0 * t, 0.0]), frames=10)[-1]
    assert last.id.tolist() == [7]
    assert last.moving.all()
    assert last.velocity[0] == pytest.approx([0.0, -10.0], abs=0.8)


def test_the_car_ahead_at_our_own_speed_moves():
    side = car_side(np.random.default_rng(4), 30, 0.0, 15.0)
    last = drive(lambda t: side + np.array([0.0, 8.0 * t, 0.0]), frames=10)[-1]
    assert last.moving.all()
    assert last.velocity[0] == pytest.approx([0.0, 8.0], abs=0.8)


def test_a_short_baseline_tells_the_car_ahead_within_two_seconds():
    side = car_side(np.random.default_rng(4), 12, 0.0, 20.0, length=0.5)
    history = drive(lambda t: side + np.array([0.0, 7.0 * t, 0.0]), frames=60, speed=7.0, n=12, camera=SHORT)
    assert all(m.moving.all() for m in history[20:])
    assert history[-1].velocity[0] == pytest.approx([0.0, 7.0], abs=1.5)


def test_a_car_that_no_feature_of_is_known_again_moves_by_the_way_it_has_come():
    side = car_side(np.random.default_rng(4), 4, 0.0, 20.0, length=0.5)
    seen = {"n": 4, "camera": SHORT, "known_again": False}
    away = drive(lambda t: side + np.array([0.0, 7.0 * t, 0.0]), frames=60, speed=7.0, **seen)
    assert all(m.moving.all() for m in away[30:])
    assert not any(m.moving.any() for m in drive(lambda t: side, frames=20, speed=7.0, **seen))


def test_a_few_places_that_are_wrong_altogether_set_nothing_in_motion():
    side = car_side(np.random.default_rng(4), 8, 3.0, 30.0, length=2.0)

    def half_hidden(t):  # for three frames all depths are those of somebody who stands before it
        return side - np.array([0.0, 9.0, 0.0]) if t < 0.25 else side

    history = drive(half_hidden, frames=30, n=8, known_again=False)
    assert not any(m.moving.any() for m in history)


def test_a_person_who_walks_across_moves():
    body = np.random.default_rng(5).uniform([-0.3, 11.8, 0.0], [0.3, 12.2, 1.7], (8, 3))
    last = drive(lambda t: body + np.array([1.4 * t, 0.0, 0.0]), n=8, frames=10, speed=3.0, label=ClassLabel.PERSON)[-1]
    assert last.moving.all()
    assert last.velocity[0] == pytest.approx([1.4, 0.0], abs=0.4)


def test_a_bicycle_at_a_rack_stands():
    frame = np.random.default_rng(6).uniform([2.5, 12.0, 0.0], [2.7, 13.7, 1.1], (10, 3))
    assert not drive(lambda t: frame, n=10, frames=10, speed=3.0, label=ClassLabel.TWO_WHEELER)[-1].moving.any()


def test_a_car_that_pulls_out_changes_from_parked_to_moving():
    side = car_side(np.random.default_rng(7), 30, 3.0, 25.0)
    history = drive(lambda t: side + np.array([0.0, 3.0 * max(t - 1.0, 0.0) ** 2, 0.0]), frames=25, speed=4.0)
    assert not history[9].moving.any()
    assert history[-1].moving.all()


def test_a_few_wrong_matches_change_nothing():
    rng = np.random.default_rng(8)
    side = car_side(rng, 30, 3.0, 15.0)

    def points(t):
        moved = side.copy()
        moved[:8] += rng.normal(0, 1.5, (8, 3))  # reflections wander over the paint
        return moved

    assert not any(m.moving.any() for m in drive(points, frames=12, speed=3.0))


def test_frames_without_instances_are_fine():
    classifier = MotionClassifier(CAMERA)
    for t in (0.0, 0.1):
        assert len(classifier.update(CameraFeatures.empty(), camera_at(0, 0), t)) == 0
    assert len(classifier.moving_ids) == 0


def test_points_are_found_again_only_within_their_instance():
    rng = np.random.default_rng(9)
    descriptors = random_descriptors(rng, 6)
    ids = np.array([1, 1, 1, 4, 4, 4], np.int32)
    same = match_within_instances(descriptors, ids, descriptors, ids)
    assert same.tolist() == [0, 1, 2, 3, 4, 5]
    other = match_within_instances(descriptors, ids, descriptors[::-1], np.array([1, 1, 1, 4, 4, 4], np.int32))
    assert other.tolist() == [-1] * 6


@pytest.mark.parametrize("jump_m", [0.3, 1.0])
def test_a_pose_that_jumps_moves_nobody(jump_m):
    rng = np.random.default_rng(10)
    side = car_side(rng, 30, 3.0, 15.0)
    street = rng.uniform([-6.0, 8.0, 0.0], [-5.5, 25.0, 5.0], (80, 3))
    points, ids = np.vstack([side, street]), np.repeat([7, 0], [30, 80])
    descriptors = random_descriptors(rng, 110)
    classifier = MotionClassifier(CAMERA)
    for k in range(12):
        features = see(points, camera_at(0.0, 0.3 * k), descriptors, ids, noise=rng)
        believed = camera_at(jump_m if k >= 6 else 0.0, 0.3 * k + (jump_m / 2 if k >= 6 else 0.0))
        motions = classifier.update(features, believed, 0.1 * k)
        assert not motions.moving.any()
