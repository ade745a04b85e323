"""A car that leaves the image keeps its id, though less and less of it is seen."""

import numpy as np

from autowaze.vehicle.semantics.instance_depth import InstanceDepths
from autowaze.vehicle.semantics.sort import Sort
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections

CAMERA = StereoCamera(fx=720.0, fy=720.0, cx=620.0, cy=187.0, baseline_m=0.54, width=1242, height=375)
PASSING = ((700, 180, 900, 300), (790, 170, 1150, 370), (880, 190, 1242, 375), (906, 244, 1242, 375))
BONNET = (1023, 355, 1242, 375)


def found(*boxes):
    n = len(boxes)
    box = np.array(boxes, np.float32).reshape(n, 4)
    return Detections(box, np.ones(n, np.uint8), np.ones(n, np.float32), np.zeros((n, 375, 1242), np.bool_))


def test_the_last_bonnet_in_the_corner_is_still_the_car():
    sort = Sort(CAMERA)
    for k, box in enumerate(PASSING):
        T_map_cam = np.eye(4)
        T_map_cam[2, 3] = 1.0 * k
        car = sort.update(found(box), T_map_cam, InstanceDepths.unknown(1)).id
    T_map_cam[2, 3] += 1.0
    assert sort.update(found(BONNET), T_map_cam, InstanceDepths.unknown(1)).id.tolist() == car.tolist()


def test_who_follows_at_the_border_keeps_an_id_of_its_own():
    sort = Sort(CAMERA)
    both = sort.update(found((906, 244, 1242, 375), (760, 180, 1060, 330)), np.eye(4), InstanceDepths.unknown(2)).id
    after = sort.update(found(BONNET, (790, 170, 1150, 370)), np.eye(4), InstanceDepths.unknown(2)).id
    assert after.tolist() == both.tolist()
