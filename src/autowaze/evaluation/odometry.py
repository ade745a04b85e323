"""Visual odometry over a trace: features and SLAM alone, no map, no segmentation."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.drive import Progress
from autowaze.evaluation.trajectory import trajectory_metrics
from autowaze.traces import Trace
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.world.frame import StereoFrame

_WARM_UP_FRAMES = 3


@dataclass(frozen=True)
class OdometryRun:
    """Tracked frames and the milliseconds (N,) that each took, features included."""

    tracked: list[TrackedFrame]
    track_ms: NDArray[np.float64]

    @property
    def T_map_cam(self) -> NDArray[np.float64]:  # noqa: N802
        """Poses (N, 4, 4)."""
        return np.stack([t.T_map_cam for t in self.tracked])

    @property
    def timestamp(self) -> NDArray[np.float64]:
        """Times (N,) of the frames, seconds."""
        return np.array([t.timestamp for t in self.tracked])


def run_odometry(trace: Trace, progress: Progress | None = None) -> OdometryRun:
    """Track a trace from its first frame; a warm-up that compiles and loads does not count."""
    _track(trace, [trace[i] for i in range(min(_WARM_UP_FRAMES, len(trace)))])
    return _track(trace, progress(trace, len(trace)) if progress else trace)


def odometry_metrics(run: OdometryRun, T_true: NDArray[np.float64]) -> dict[str, float]:
    """Errors against true poses (N, 4, 4), and times."""
    return {
        **trajectory_metrics(run.T_map_cam, T_true),
        "trusted_fraction": float(np.mean([t.is_trustworthy for t in run.tracked])),
        "track_ms_median": float(np.median(run.track_ms)),
        "track_ms_p95": float(np.percentile(run.track_ms, 95)),
    }


def _track(trace: Trace, frames: Iterable[StereoFrame]) -> OdometryRun:
    extractor, slam = FeatureExtractor(trace.camera), StereoSlam(trace.camera)
    tracked, milliseconds = [], []
    for frame in frames:
        frame.left_grey, frame.right_grey  # noqa: B018  decoding is the camera's work
        start = time.perf_counter()
        tracked.append(slam.track(extractor.extract(frame), frame.timestamp, frame.index))
        milliseconds.append(1000 * (time.perf_counter() - start))
    slam.finish()
    return OdometryRun(tracked, np.array(milliseconds))
