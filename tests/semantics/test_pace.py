"""How often to segment on slow machines and fast ones."""

import pytest

from autowaze.vehicle.semantics.pace import measure_pace
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections

CAMERA = StereoCamera(720.0, 720.0, 20.0, 15.0, 0.54, 40, 30)


class SlowMachine:
    """A segmenter and the clock that it moves on; the first run takes ten times as long."""

    name = "slow"

    def __init__(self, seconds):
        self.seconds, self.now, self.runs = seconds, 0.0, 0

    def segment(self, image):
        self.now += self.seconds * (10 if self.runs == 0 else 1)
        self.runs += 1
        return Detections.empty(*image.shape)

    def clock(self):
        return self.now


@pytest.mark.parametrize(("seconds", "every_nth"), [(0.03, 1), (0.079, 1), (0.09, 2), (0.3, 4)])
def test_a_slow_machine_segments_less_often(seconds, every_nth):
    machine = SlowMachine(seconds)
    pace = measure_pace(machine, CAMERA, frame_interval_s=0.1, clock=machine.clock)
    assert pace.segment_s == pytest.approx(seconds)
    assert pace.every_nth == every_nth
