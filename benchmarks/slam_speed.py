"""Time per frame of extraction and tracking, and the odometry errors: `python benchmarks/slam_speed.py DRIVE...`."""

from __future__ import annotations

import sys
import time

import numpy as np

from autowaze.evaluation.trajectory import absolute_errors, relative_errors
from autowaze.traces import open_trace
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.vision.extractor import FeatureExtractor

_WARM_UP_FRAMES = 3  # compiled code is loaded in the first ones


def measure(folder: str) -> None:
    trace = open_trace(folder)
    extractor, slam = FeatureExtractor(trace.camera), StereoSlam(trace.camera)
    poses, seconds = [], []
    for frame in [trace[i] for i in range(len(trace))]:
        start = time.perf_counter()
        features = extractor.extract(frame)
        extracted = time.perf_counter()
        poses.append(slam.track(features, frame.timestamp, frame.index).T_map_cam)
        seconds.append((extracted - start, time.perf_counter() - extracted))
    slam.finish()
    ms = 1e3 * np.array(seconds[_WARM_UP_FRAMES:])
    for name, column in (("extract", ms[:, 0]), ("track", ms[:, 1]), ("both", ms.sum(axis=1))):
        print(f"{trace.name:12s} {name:8s} ms: least {column.min():5.1f}  median {np.median(column):5.1f}  "
              f"p95 {np.percentile(column, 95):5.1f}")  # fmt: skip
    if trace.ground_truth is not None:
        T, truth = np.stack(poses), trace.ground_truth.T_world_cam
        rpe_cm, ape_m = 100 * relative_errors(T, truth).mean, absolute_errors(T, truth).rmse
        print(f"{trace.name:12s} rpe_mean_cm {rpe_cm:.3f}  ape_rmse_m {ape_m:.3f}")


if __name__ == "__main__":
    for drive in sys.argv[1:]:
        measure(drive)
