"""The sky is not segmented, and what is found below it lies where it is in the image."""

import numpy as np

from autowaze.vehicle.semantics.street_view import StreetView
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections
from autowaze.world.labels import ClassLabel

TALL = StereoCamera(528.0, 528.0, 639.5, 359.5, 0.12, 1280, 720)
WIDE = StereoCamera(721.5, 721.5, 609.6, 172.9, 0.54, 1242, 375)


class Corner:
    """Finds whatever is in the lower right corner of what it is shown."""

    name = "corner"

    def segment(self, image):
        self.shown = image.shape
        mask = np.zeros((1, *image.shape[:2]), np.bool_)
        mask[0, -40:, -100:] = True
        height, width = image.shape[:2]
        box = np.array([[width - 100, height - 40, width, height]], np.float32)
        return Detections(box, np.array([ClassLabel.CAR], np.uint8), np.ones(1, np.float32), mask)


def seen(camera, channels=()):
    corner = Corner()
    found = StreetView(corner, camera).segment(np.zeros((camera.height, camera.width, *channels), np.uint8))
    assert found.mask.shape == (1, camera.height, camera.width)
    assert found.mask[0, -40:, -100:].all()
    assert found.mask.sum() == 40 * 100
    assert found.box.tolist() == [[camera.width - 100, camera.height - 40, camera.width, camera.height]]
    return corner.shown


def test_a_tall_image_is_cut_twenty_degrees_above_the_axis():
    cut = 720 - seen(TALL, (3,))[0]
    assert 19.9 < np.degrees(np.arctan((TALL.cy - cut) / TALL.fy)) < 20.1


def test_an_image_that_shows_little_sky_is_segmented_whole():
    assert seen(WIDE) == (375, 1242)
