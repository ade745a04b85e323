"""Odometry on real drives: milliseconds of extraction and tracking, and the errors.

Errors are those of the poses as told when each frame came, and of the trajectory as known after the drive.
"""

from __future__ import annotations

import time

import numpy as np
from rich.console import Console
from rich.table import Table

from autowaze.evaluation.trajectory import absolute_errors, relative_errors
from autowaze.traces import Trace, open_trace
from autowaze.vehicle.slam.loops.correction import DriveCorrection
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.vision.extractor import FeatureExtractor
from benchmarks.data import DRIVES

_WARM_UP_FRAMES = 3  # compiled code is loaded in the first ones
_RUNS = 3


def run() -> None:
    columns = "drive", "run", "extract ms", "track ms", "both ms", "p95 ms", "CPU ms", "told RPE cm", "APE m"
    table = Table(*columns, "after RPE cm", "APE m", title="odometry")
    for folder in DRIVES:
        trace = open_trace(folder)
        for number in range(_RUNS):
            table.add_row(trace.name, str(number + 1), *measure(trace))
    Console(width=120).print(table)


def measure(trace: Trace) -> list[str]:
    extractor, slam = FeatureExtractor(trace.camera), StereoSlam(trace.camera)
    poses, seconds = [], []
    frames, cpu = [trace[i] for i in range(len(trace))], time.process_time()
    for frame in frames:
        start = time.perf_counter()
        features = extractor.extract(frame)
        extracted = time.perf_counter()
        poses.append(slam.track(features, frame.timestamp, frame.index).T_map_cam)
        seconds.append((extracted - start, time.perf_counter() - extracted))
    slam.finish()
    cpu = 1e3 * (time.process_time() - cpu) / len(frames)
    extract, track = 1e3 * np.array(seconds[_WARM_UP_FRAMES:]).T
    both = extract + track
    slam.loops.adjust()
    told, truth = np.stack(poses), trace.ground_truth.T_world_cam
    after = DriveCorrection(slam.loops, told).poses()
    times = (np.median(extract), np.median(track), np.median(both), np.percentile(both, 95), cpu)
    errors = [(100 * relative_errors(T, truth).mean, absolute_errors(T, truth).rmse) for T in (told, after)]
    return [f"{t:.1f}" for t in times] + [f"{value:.3f}" for pair in errors for value in pair]
