"""What a window knows of the landmarks that it found."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing.found import FoundLandmarks
from autowaze.vehicle.diffing.novelty import Candidates
from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import make_pose

NARROW = StereoCamera(fx=528.0, fy=528.0, cx=640.0, cy=360.0, baseline_m=0.12, width=1280, height=720)
PLACES = np.array([[9.0, 0.0, 30.0], [0.1, 0.0, 120.0], [2.0, 0.0, 6.0]])
ROADSIDE, STRAIGHT_AHEAD, NEAR = range(3)


def found_from(places_along: NDArray[np.float64]) -> Candidates:
    """Frames that look north along a street, from these places on it."""
    landmarks, found = Landmarks(), FoundLandmarks(NARROW)
    ids = landmarks.add(position=PLACES)
    none = CameraFeatures.empty()
    for index, along in enumerate(places_along.tolist()):
        T = make_pose(np.eye(3), np.array([0.0, 0.0, along]))
        seen = (PLACES - T[:3, 3]).astype(np.float32)
        columns = {name: np.zeros((3, *column.shape[1:]), column.dtype) for name, column in vars(none).items()}
        features = replace(none, **columns | {"depth": seen[:, 2], "position_cam": seen})
        state, nothing = TrackingState.ODOMETRY, np.zeros(0, np.int64)
        found.add(TrackedFrame(index, 0.1 * index, state, "", T, np.eye(6), 3, 0, ids, nothing), features)
    return found.candidates(landmarks, nothing, DiffSettings())


def test_a_short_baseline_knows_far_places_once_the_car_has_moved() -> None:
    standing, moving = found_from(np.zeros(10)), found_from(np.arange(10.0))
    assert standing.depth_sigma_m[ROADSIDE] > 2.0
    assert standing.position_sigma_m[ROADSIDE] > 2.0
    assert moving.position_sigma_m[ROADSIDE] < 0.75
    assert moving.offset_px[ROADSIDE] < 2.0 < standing.offset_px[ROADSIDE]


def test_what_lies_straight_ahead_stays_uncertain() -> None:
    moving = found_from(np.arange(10.0))
    assert moving.position_sigma_m[STRAIGHT_AHEAD] > 20.0


def test_stereo_tells_where_near_things_are() -> None:
    standing = found_from(np.zeros(3))
    assert np.isclose(standing.position_sigma_m[NEAR], standing.depth_sigma_m[NEAR], rtol=0.05)
