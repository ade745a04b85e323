"""What tells that a stored vehicle is not there any more."""

import numpy as np

from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.vehicle.diffing.stored_watch import StoredFeatureWatch, _on_free_ground
from autowaze.vehicle.ground import GroundObservation
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import MapFeatures
from autowaze.world.features import CameraFeatures

CAMERA = StereoCamera(fx=100.0, fy=100.0, cx=50.0, cy=50.0, baseline_m=0.1, width=100, height=100)


def test_no_vehicle_stands_where_its_ground_is_seen_free() -> None:
    ix, iy = (column.ravel().astype(np.int32) for column in np.meshgrid(np.arange(-3, 3), np.arange(-3, 3)))
    free = ~((ix == 1) & (iy == 1))
    ground = GroundObservation(ix, iy, free, ~free, np.zeros((50, 50), np.float32), CAMERA, None)
    beside, corner, edge = [0.1, 0.3, 1.0], [0.1, 0.1, 1.0], [-0.6, -0.1, 0.5]
    places = np.array([[0.3, 0.3, 1.0], beside, corner, edge, [-0.4, -0.1, 0.5], [9.0, 9.0, 1.0]])
    assert _on_free_ground(places, ground).tolist() == [False, False, True, False, True, False]


FORWARD = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
NEAR, FAR = [10.0, 0.0, 0.0], [20.0, 2.0, 0.0]


def missed_in_three_frames(baseline_m: float) -> list[float]:
    """Of stored features of vehicles at `NEAR` and `FAR`, whose surfaces are seen, but no corner on them."""
    camera = StereoCamera(fx=720.0, fy=720.0, cx=320.0, cy=160.0, baseline_m=baseline_m, width=640, height=320)
    blank = {name: np.zeros((2, *column.shape[1:]), column.dtype) for name, column in vars(MapFeatures.empty()).items()}
    cars = MapFeatures(**blank | {"id": np.array([1, 2], np.uint64), "position": np.array([NEAR, FAR])})
    depth = np.full((320, 640), 20.0, np.float32)
    depth[:, 300:] = 10.0
    no_cells, nothing = np.zeros(0, np.int32), np.zeros(0, np.int64)
    ground = GroundObservation(no_cells, no_cells, no_cells > 0, no_cells > 0, depth, camera, None)
    watch = StoredFeatureWatch(cars, DiffSettings().known_radius_m, camera)
    for index in range(3):
        tracked = TrackedFrame(
            index, 0.1 * index, TrackingState.LOCALIZED, "", FORWARD, 1e-4 * np.eye(6), 90, 90, nothing, nothing
        )
        watch.add(tracked, CameraFeatures.empty(), ground, Landmarks())
    looked_for = watch.looked_for()
    missed = dict(zip(looked_for.map_id.tolist(), looked_for.missed.tolist(), strict=True))
    return [missed.get(1, 0.0), missed.get(2, 0.0)]


def test_a_corner_not_found_says_less_where_there_is_hardly_room_for_one() -> None:
    near, far = missed_in_three_frames(baseline_m=0.54)
    assert near == 3.0
    assert 0.6 < far < 0.9, "0.35 m take 12.6 px there, of the 20 that a corner has to itself"


def test_where_stereo_would_not_put_it_there_a_corner_not_found_says_nothing() -> None:
    assert missed_in_three_frames(baseline_m=0.12) == [3.0, 0.0]
