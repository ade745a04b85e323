"""A car tells of the ground where it knows that people park, as it learns of it."""

import numpy as np
import pytest
import shapely

from autowaze.vehicle.diffing import DiffSettings, DiffWindow, FrameObservation
from autowaze.vehicle.ground import GroundObservation
from autowaze.vehicle.semantics.motion import Motions
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.camera import StereoCamera
from autowaze.world.errors import AutowazeError
from autowaze.world.features import CameraFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.instances import Tracks
from autowaze.world.parking import ParkingMap, ParkingSpot
from autowaze.world.pose import heading_to_rotation, make_pose
from autowaze.world.wire import decode_diff, encode_diff

CAMERA = StereoCamera(fx=700.0, fy=700.0, cx=320.0, cy=120.0, baseline_m=0.5, width=640, height=240)
HERE, ELSEWHERE = Georeference(40.0, -73.0), Georeference(41.0, -73.0)


def look(window, second, pose=None, state=TrackingState.ODOMETRY, sigma_m=0.001):
    """A frame that sees 200 x 200 cells of free road about the origin."""
    ix, iy = (axis.ravel().astype(np.int32) for axis in np.meshgrid(np.arange(-100, 100), np.arange(-100, 100)))
    free = np.ones(len(ix), np.bool_)
    depth = np.full((CAMERA.height // 2, CAMERA.width // 2), np.nan, np.float32)
    ground = GroundObservation(ix, iy, free, ~free, depth, CAMERA, None)
    none = np.zeros(0, np.int64)
    pose, covariance = np.eye(4) if pose is None else pose, sigma_m**2 * np.eye(6)
    tracked = TrackedFrame(0, second, state, "", pose, covariance, 0, 0, none, none)
    features, tracks = CameraFeatures.empty(), Tracks.empty(CAMERA.height, CAMERA.width)
    window.add(FrameObservation(tracked, features, tracks, Motions.empty(), ground), Landmarks())


def told(window, start):
    """Centres of the cells of one window's diff."""
    look(window, start), look(window, start + 2.5)
    return window.close(Landmarks()).ground.centre


def spots_at(*places, georeference=HERE):
    spots = [ParkingSpot(str(n), shapely.box(x - 1, y - 1, x + 1, y + 1)) for n, (x, y) in enumerate(places)]
    return ParkingMap(tuple(spots), georeference)


def test_the_ground_is_told_of_at_the_spots_that_are_known_by_now():
    window = DiffWindow(CAMERA, 1, DiffSettings(), georeference=HERE)
    everywhere = told(window, 0.0)
    window.replace_spots(spots_at((3.0, 0.0)))
    right = told(window, 5.0)
    window.replace_spots(spots_at((-3.0, 0.0), (50.0, 0.0)))
    left = told(window, 10.0)
    window.replace_spots(spots_at())
    nowhere = told(window, 15.0)
    assert len(everywhere) > len(right) > 0 and len(left) > 0 == len(nowhere)
    assert np.abs(right - [3.0, 0.0]).max() < 4 and np.abs(left - [-3.0, 0.0]).max() < 4


@pytest.mark.parametrize(("sigma_m", "is_told"), [(5.0, False), (0.3, True)])
def test_what_was_seen_from_an_unsure_place_is_taken_back_when_the_map_is_found(sigma_m, is_told):
    window = DiffWindow(CAMERA, 1, DiffSettings(), georeference=HERE, spots=spots_at((0.0, 0.0), (3.0, 0.0)))
    look(window, 0.0, sigma_m=sigma_m)
    look(window, 2.5, state=TrackingState.LOCALIZED)
    diff = window.close(Landmarks())
    assert diff.frames == 2 and diff.localized_frames == (2 if is_told else 1)
    assert diff.start == 0.0
    look(window, 5.0, state=TrackingState.LOCALIZED), look(window, 7.5, state=TrackingState.LOCALIZED, sigma_m=5.0)
    assert window.close(Landmarks()).localized_frames == 2  # unsure by and by, nothing was elsewhere


def test_spots_in_another_map_frame_say_nothing():
    window = DiffWindow(CAMERA, 1, DiffSettings(), georeference=HERE, spots=spots_at(georeference=ELSEWHERE))
    assert len(told(window, 0.0)) > 10_000


def test_spots_change_between_two_windows_only():
    window = DiffWindow(CAMERA, 1, DiffSettings(), georeference=HERE)
    look(window, 0.0)
    with pytest.raises(AutowazeError, match="between two windows"):
        window.replace_spots(spots_at())


def pose_at(x, y):
    """A camera that looks north."""
    return make_pose(heading_to_rotation(0.0), np.array([x, y, 0.0]))


def test_ground_ahead_is_told_of_once_when_it_has_been_passed():
    window = DiffWindow(CAMERA, 1, DiffSettings(), georeference=HERE, spots=spots_at((0.0, 0.0), (0.0, 15.0)))
    look(window, 0.0, pose_at(0.0, -2.0)), look(window, 2.5, pose_at(0.0, 0.0))
    here = window.close(Landmarks()).ground.centre
    assert len(here) and here[:, 1].max() < 5
    look(window, 5.0, pose_at(0.0, 10.0)), look(window, 7.5, pose_at(0.0, 20.0))
    both = window.close(Landmarks()).ground.centre
    assert len(both) and (np.abs(both[:, 1] - 15.0).min() < 1)
    assert window.is_told


@pytest.mark.parametrize("windows", [1, 2, 3])
def test_ground_ahead_of_a_car_that_stands_is_told_of_in_the_end(windows):
    window = DiffWindow(CAMERA, 1, DiffSettings(), georeference=HERE, spots=spots_at((0.0, 15.0)))
    told_of = []
    for number in range(windows):
        look(window, 5.0 * number, pose_at(0.0, 0.0)), look(window, 5.0 * number + 2.5, pose_at(0.0, 0.0))
        told_of.append(len(window.close(Landmarks()).ground))
    assert [bool(count) for count in told_of] == [False, False, True][:windows]
    assert window.is_told == (windows == 3)
    if windows < 3:
        last = window.close(Landmarks(), last=True)
        assert len(last.ground) and len(last.trajectory) == 1
        assert len(decode_diff(encode_diff(last)).ground) == len(last.ground)


def test_the_path_keeps_the_points_that_even_motion_does_not_foretell():
    window = DiffWindow(CAMERA, 1, DiffSettings(), georeference=HERE)
    for second, (x, y) in enumerate([(0, 0), (0, 6), (0, 12), (6, 12), (12, 12)]):
        look(window, float(second), pose_at(x, y))
    assert window.close(Landmarks()).trajectory.time.tolist() == [0.0, 2.0, 4.0]
