"""What tells that a stored vehicle is not there any more."""

import numpy as np

from autowaze.vehicle.diffing.stored_watch import _on_free_ground
from autowaze.vehicle.ground import GroundObservation
from autowaze.world.camera import StereoCamera

CAMERA = StereoCamera(fx=100.0, fy=100.0, cx=50.0, cy=50.0, baseline_m=0.1, width=100, height=100)


def test_no_vehicle_stands_where_its_ground_is_seen_free() -> None:
    ix, iy = (column.ravel().astype(np.int32) for column in np.meshgrid(np.arange(-3, 3), np.arange(-3, 3)))
    free = ~((ix == 1) & (iy == 1))
    ground = GroundObservation(ix, iy, free, ~free, np.zeros((50, 50), np.float32), CAMERA, None)
    beside, corner, edge = [0.1, 0.3, 1.0], [0.1, 0.1, 1.0], [-0.6, -0.1, 0.5]
    places = np.array([[0.3, 0.3, 1.0], beside, corner, edge, [-0.4, -0.1, 0.5], [9.0, 9.0, 1.0]])
    assert _on_free_ground(places, ground).tolist() == [False, False, True, False, True, False]
