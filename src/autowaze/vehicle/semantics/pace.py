"""How often a machine can afford to segment, by measurement."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.camera import StereoCamera

_RUNS = 3
_LOAD = 0.8  # of the time between frames; the rest of the pipeline wants its share


@dataclass(frozen=True, slots=True)
class Pace:
    """What was measured and what follows.

    Attributes:
        segment_s: median time of one segmentation, seconds.
        every_nth: frames from one segmentation to the next, so that it keeps up.
    """

    segment_s: float
    every_nth: int


def measure_pace(
    segmenter: Segmenter,
    camera: StereoCamera,
    frame_interval_s: float = 0.1,
    clock: Callable[[], float] = time.perf_counter,
) -> Pace:
    """Segment a few blank images of the camera's size; the first, which warms the network up, does not count.

    A drive that must be repeatable states `every_nth` instead of measuring it.
    """
    blank = np.full((camera.height, camera.width), 128, np.uint8)
    segmenter.segment(blank)
    times = []
    for _ in range(_RUNS):
        start = clock()
        segmenter.segment(blank)
        times.append(clock() - start)
    segment_s = float(np.median(times))
    return Pace(segment_s, max(1, math.ceil(segment_s / (_LOAD * frame_interval_s))))
