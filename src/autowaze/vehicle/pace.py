"""How often a machine can afford to segment, by measurement."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.semantics.no_segmentation import NoSegmentation
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.camera import StereoCamera
from autowaze.world.frame import StereoFrame

FRAMES = 5
_WARM_UP = 2
_LOAD = 0.9  # of the time between frames
_MOST = 5  # masks are followed by optical flow, which loses what has moved on for half a second


@dataclass(frozen=True, slots=True)
class Pace:
    """What was measured and what follows.

    Attributes:
        rest_s: median time that a car takes for a frame without segmentation, seconds.
        segment_s: how much longer it takes with it.
        every_nth: frames from one segmentation to the next, so that the car keeps up on average; 5 at most.
        keeps_up: whether it does.
    """

    rest_s: float
    segment_s: float
    every_nth: int
    keeps_up: bool


def measure_pace(
    segmenter: Segmenter,
    camera: StereoCamera,
    frames: Sequence[StereoFrame],
    frame_interval_s: float,
    clock: Callable[[], float] = time.perf_counter,
) -> Pace:
    """Let two cars, without segmentation and with it, drive over a few frames; the first two do not count.

    A drive that must be repeatable states how often it segments instead.

    Args:
        frames: at least three, as they will come: `FRAMES` are enough.
        frame_interval_s: seconds from one to the next.
    """
    rest_s, whole_s = (_frame_s(camera, eyes, frames, clock) for eyes in (NoSegmentation(), segmenter))
    segment_s, left_s = max(whole_s - rest_s, 0.0), _LOAD * frame_interval_s - rest_s
    needed = max(1, math.ceil(segment_s / left_s)) if left_s > 0 else _MOST + 1
    return Pace(rest_s, segment_s, min(needed, _MOST), needed <= _MOST)


def _frame_s(
    camera: StereoCamera, segmenter: Segmenter, frames: Sequence[StereoFrame], clock: Callable[[], float]
) -> float:
    node, times = VehicleNode(camera, segmenter), []
    for frame in frames:
        begun = clock()
        node.process(frame)
        times.append(clock() - begun)
    node.finish()
    return float(np.median(times[_WARM_UP:]))
