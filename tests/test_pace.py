"""How often to segment on slow machines and fast ones."""

import numpy as np
import pytest

from autowaze.vehicle.pace import FRAMES, measure_pace
from autowaze.world.camera import StereoCamera
from autowaze.world.frame import StereoFrame
from autowaze.world.instances import Detections

CAMERA = StereoCamera(300.0, 300.0, 160.0, 60.0, 0.54, 320, 120)
BLANK = np.full((CAMERA.height, CAMERA.width), 128, np.uint8)
DRIVE = [StereoFrame(row, 0.1 * row, BLANK, BLANK) for row in range(FRAMES)]


class SlowMachine:
    """A segmenter and the clock that it moves on; the first run takes ten times as long. Reading the clock takes time,
    too: that is the rest of a frame.
    """

    name = "slow"

    def __init__(self, seconds, rest=0.0):
        self.seconds, self.rest, self.now, self.runs = seconds, rest, 0.0, 0

    def segment(self, image):
        self.now += self.seconds * (10 if self.runs == 0 else 1)
        self.runs += 1
        return Detections.empty(*image.shape)

    def clock(self):
        self.now += self.rest
        return self.now


@pytest.mark.parametrize(
    ("seconds", "rest", "every_nth", "keeps_up"),
    [
        (0.03, 0.0, 1, True),
        (0.08, 0.0, 1, True),
        (0.08, 0.03, 2, True),
        (0.3, 0.0, 4, True),
        (2.0, 0.03, 5, False),
        (0.01, 0.12, 5, False),
    ],
)
def test_a_slow_machine_segments_less_often(seconds, rest, every_nth, keeps_up):
    machine = SlowMachine(seconds, rest)
    pace = measure_pace(machine, CAMERA, DRIVE, 0.1, clock=machine.clock)
    assert (pace.segment_s, pace.rest_s) == (pytest.approx(seconds), pytest.approx(rest))
    assert (pace.every_nth, pace.keeps_up) == (every_nth, keeps_up)
