"""Moving or parked by the size of vehicles in the image, where stereo says little."""

import numpy as np
import pytest
from scene import camera_at, car_side, random_descriptors, see

from autowaze.vehicle.semantics.looming import sights_of
from autowaze.vehicle.semantics.motion import MotionClassifier
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Tracks
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import inverse, transform

SHORT = StereoCamera(528.0, 528.0, 639.5, 359.5, 0.12, 1280, 720)
ID = 7


def tracks(*boxes, label=ClassLabel.CAR):
    n = len(boxes)
    return Tracks(
        np.arange(ID, ID + n, dtype=np.int32),
        np.array(boxes, np.float32).reshape(n, 4),
        np.full(n, label, np.uint8),
        np.full(n, 0.9, np.float32),
        np.zeros((n, 4, 4), np.bool_),
    )


def box_of_back(T_map_cam, east, north, height=1.5, seen=1.0):
    """Box of the back of a car on the ground, 1.8 m wide; of its height that share from the top is seen."""
    corners = [[east + x, north, z] for x in (-0.9, 0.9) for z in (height * (1.0 - seen), height)]
    uv = SHORT.project(transform(inverse(T_map_cam), np.array(corners)))[:, :2]
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])


def drive(north_at, height=1.5, seen_at=lambda k: 1.0, frames=20, speed=8.0, rate=6.0, seed=0):
    """Whether a car ahead is told to move, frame by frame; it is smooth: three points, none of them known again."""
    rng, classifier, verdicts = np.random.default_rng(seed), MotionClassifier(SHORT), []
    for k in range(frames):
        t = k / rate
        here, north = camera_at(0.0, speed * t), north_at(t)
        points = car_side(rng, 3, 0.2, north, length=0.3)
        features = see(points, here, random_descriptors(rng, 3), ID, noise=rng, sigma_px=0.5, camera=SHORT)
        box = box_of_back(here, 0.2, north, height, seen_at(k)) + rng.normal(0.0, 0.5, 4)
        verdicts.append(bool(classifier.update(features, here, t, tracks(box)).moving[0]))
    return verdicts


@pytest.mark.parametrize("seed", range(5))
def test_a_car_ahead_that_grows_no_larger_as_we_drive_on_moves(seed):
    assert all(drive(lambda t: 24.0 + 8.0 * t, seed=seed)[9:])


@pytest.mark.parametrize("height", [1.3, 1.5, 2.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_parked_car_that_looms_stands(height, seed):
    assert not any(drive(lambda t: 34.0, height, seed=seed))


@pytest.mark.parametrize("seed", range(5))
def test_what_hid_the_lower_half_of_a_parked_car_sets_it_in_motion_for_nobody(seed):
    assert not any(drive(lambda t: 34.0, seen_at=lambda k: min(1.0, 0.4 + 0.05 * k), seed=seed))


def test_a_vehicle_is_measured_where_all_of_it_is_seen():
    behind, before = (600.0, 340.0, 660.0, 390.0), (640.0, 335.0, 740.0, 420.0)
    at_border, walker = (0.0, 340.0, 60.0, 390.0), (900.0, 330.0, 920.0, 390.0)
    T_map_cam = camera_at(3.0, 4.0)
    assert sights_of(SHORT, tracks(), T_map_cam, 0.0) == {}
    assert sights_of(SHORT, tracks(walker, label=ClassLabel.PERSON), T_map_cam, 0.0) == {}
    seen = sights_of(SHORT, tracks(behind, before, at_border), T_map_cam, 0.5)
    assert list(seen) == [ID + 1]
    assert seen[ID + 1].depth_per_metre == pytest.approx(528.0 / 85.0)
    assert seen[ID + 1].camera == pytest.approx([3.0, 4.0])
    assert seen[ID + 1].ray == pytest.approx([(690.0 - 639.5) / 528.0, 1.0])
