"""Visual odometry over a trace: features and SLAM alone, no map, no segmentation."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.drive import Progress
from autowaze.evaluation.trajectory import absolute_errors, trajectory_metrics
from autowaze.traces import Trace
from autowaze.vehicle.slam.loops.correction import DriveCorrection
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.world.frame import StereoFrame

_WARM_UP_FRAMES = 3


@dataclass(frozen=True)
class OdometryRun:
    """A tracked drive.

    Attributes:
        tracked: one per frame, as told when it came.
        track_ms: (N,) milliseconds that each took, features included.
        T_adjusted: (N, 4, 4) poses as they are known after the drive: its loops closed, its places adjusted together.
        n_loops: places at which the drive found that it had been there before.
        n_open: frames until the first loop was closed; all of them where there is none.
    """

    tracked: list[TrackedFrame]
    track_ms: NDArray[np.float64]
    T_adjusted: NDArray[np.float64]
    n_loops: int
    n_open: int

    @property
    def T_map_cam(self) -> NDArray[np.float64]:  # noqa: N802
        """Poses (N, 4, 4) as told."""
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
    """Errors against true poses (N, 4, 4), and times.

    Without a prefix: the trajectory as it is known after the drive, which is what SLAM systems write (ORB-SLAM2 places
    each frame by its keyframe as adjusted to the end) and what evaluations of them compare. `told`: the poses as they
    were given out when each frame came, which diffs are made with and which nothing takes back.
    """
    told, before_closing = trajectory_metrics(run.T_map_cam, T_true), slice(run.n_open)
    return {
        **trajectory_metrics(run.T_adjusted, T_true),
        **{f"told_{name}": told[name] for name in ("rpe_mean_cm", "ape_rmse_m", "ape_max_m", "drift_percent")},
        "loops": float(run.n_loops),
        "told_before_closing_ape_rmse_m": absolute_errors(run.T_map_cam[before_closing], T_true[before_closing]).rmse,
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
    slam.loops.adjust()
    T_adjusted = DriveCorrection(slam.loops, np.stack([t.T_map_cam for t in tracked])).poses()
    n_open = slam.loops.closings[0] - 1 if slam.loops.closings else len(tracked)
    return OdometryRun(tracked, np.array(milliseconds), T_adjusted, len(slam.loops.loops), n_open)
