"""What tells that a stored vehicle is not there any more."""

from dataclasses import replace

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


def test_a_corner_not_found_speaks_only_where_corners_are_dense_enough_for_one() -> None:
    kitti = StereoCamera(fx=720.0, fy=720.0, cx=320.0, cy=160.0, baseline_m=0.54, width=640, height=320)
    forward = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    near, far = [10.0, 0.0, 0.0], [20.0, 2.0, 0.0]
    blank = MapFeatures.empty()
    cars = replace(
        blank,
        **{name: np.zeros((2, *column.shape[1:]), column.dtype) for name, column in vars(blank).items()}
        | {"id": np.array([1, 2], np.uint64), "position": np.array([near, far])},
    )
    depth = np.full((320, 640), 20.0, np.float32)
    depth[:, 300:] = 10.0
    no_cells, nothing = np.zeros(0, np.int32), np.zeros(0, np.int64)
    ground = GroundObservation(no_cells, no_cells, no_cells > 0, no_cells > 0, depth, kitti, None)
    watch = StoredFeatureWatch(cars, DiffSettings().known_radius_m, kitti)
    for index in range(3):
        tracked = TrackedFrame(
            index, 0.1 * index, TrackingState.LOCALIZED, "", forward, 1e-4 * np.eye(6), 90, 90, nothing, nothing
        )
        watch.add(tracked, CameraFeatures.empty(), ground, Landmarks())
    looked_for = watch.looked_for()
    assert looked_for.map_id.tolist() == [1]
    assert looked_for.missed.tolist() == [3]
