"""Where each millisecond of tracking goes: processor time per frame by step, each step on one thread."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from autowaze.traces import open_trace
from autowaze.vehicle.slam import local_mapper, slam, tracker
from autowaze.vehicle.slam.loops import closer, looking_back
from autowaze.vehicle.vision import corners, extractor, orb, pyramid
from benchmarks.data import DRIVES

_WARM_UP_FRAMES = 5
_STEPS: tuple[tuple[str, Any, str], ...] = (
    ("pyramids of both images", pyramid.Pyramid, "fill"),
    ("corners", corners.CornerFinder, "find"),
    ("orientation, descriptors", orb.OrbDetector, "describe"),
    ("stereo", extractor, "match_stereo"),
    ("sorting into cells", slam.StereoSlam, "_observe"),
    ("pose against the last frame", tracker.Tracker, "from_last"),
    ("pose in the local map", tracker.Tracker, "in_map"),
    ("keyframe", local_mapper.LocalMapper, "insert"),
    ("taking over an adjustment", local_mapper.LocalMapper, "adopt"),
    ("remembering places", closer.LoopCloser, "remember"),
    ("bundle adjustment, own thread", local_mapper, "adjust"),
    ("places and loops, own thread", looking_back.LookingBack, "__call__"),
)


class _Inline(Executor):
    """Does the helper's work at once, so that every step is timed alone."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


def run() -> None:
    spent: dict[str, list[float]] = defaultdict(list)
    for name, owner, attribute in _STEPS:
        setattr(owner, attribute, _timed(getattr(owner, attribute), spent[name]))
    table = Table("step", *(folder.name for folder in DRIVES), title="processor time per frame, ms")
    columns = [_measure(folder, spent) for folder in DRIVES]
    for name, _, _ in _STEPS:
        table.add_row(name, *(f"{column[name]:.2f}" for column in columns))
    Console(width=100).print(table)


def _measure(folder: Any, spent: dict[str, list[float]]) -> dict[str, float]:
    trace = open_trace(folder)
    features, odometry = extractor.FeatureExtractor(trace.camera), slam.StereoSlam(trace.camera)
    features._helper = _Inline()  # type: ignore[assignment]
    odometry._mapper._worker = ThreadPoolExecutor(1)
    for i in range(len(trace)):
        if i == _WARM_UP_FRAMES:
            for seconds in spent.values():
                seconds.clear()
        odometry.track(features.extract(trace[i]), trace[i].timestamp, i)
    odometry.finish()
    return {name: 1e3 * float(np.sum(s)) / (len(trace) - _WARM_UP_FRAMES) for name, s in spent.items()}


def _timed(function: Callable[..., Any], spent: list[float]) -> Callable[..., Any]:
    def timed(*args: Any, **kwargs: Any) -> Any:
        start = time.thread_time()
        result = function(*args, **kwargs)
        spent.append(time.thread_time() - start)
        return result

    return timed
