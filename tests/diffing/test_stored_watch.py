"""What tells that a stored vehicle is not there any more."""

import numpy as np

from autowaze.vehicle.diffing.stored_watch import _on_free_ground
from autowaze.vehicle.ground import GroundObservation
from autowaze.world.camera import StereoCamera

CAMERA = StereoCamera(fx=100.0, fy=100.0, cx=50.0, cy=50.0, baseline_m=0.1, width=100, height=100)


def test_no_vehicle_stands_where_its_ground_is_seen_free() -> None:
    ix, iy = np.array([0, 1, -3], np.int32), np.array([0, 1, -1], np.int32)
    free = np.array([True, False, True])
    ground = GroundObservation(ix, iy, free, ~free, np.zeros((50, 50), np.float32), CAMERA, None)
    places = np.array([[0.1, 0.2, 1.0], [0.3, 0.3, 1.0], [-0.6, -0.1, 0.5], [-0.6, 0.1, 0.5], [9.0, 9.0, 1.0]])
    assert _on_free_ground(places, ground).tolist() == [True, False, True, False, False]
