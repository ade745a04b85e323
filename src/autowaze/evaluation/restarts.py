"""How soon a car that is switched on somewhere along a drive finds itself in the stored map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.traces import Trace
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackingState
from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import Pose

_PATIENCE_FRAMES = 10
_SOON_FRAMES = 5
_WRONG_M = 1.0


@dataclass(frozen=True)
class Restarts:
    """Starts along a drive, S rows.

    Attributes:
        frame: (S,) int64, row of the frame at which the car was switched on.
        frames_needed: (S,) int64, frames until the first localised one, that included; 0 where none of the first ten
            was.
        error_m: (S,) float64, position error of that frame, metres; NaN where there was none.
    """

    frame: NDArray[np.int64]
    frames_needed: NDArray[np.int64]
    error_m: NDArray[np.float64]

    def metrics(self) -> dict[str, float]:
        """Flat names for reports. A start counts as localised only where it is less than a metre off."""
        right = self.frames_needed > 0
        right[right] = self.error_m[right] < _WRONG_M
        out = {
            "starts": float(len(self.frame)),
            "starts_localized_fraction": float(np.mean(right & (self.frames_needed <= _SOON_FRAMES))),
            "starts_localized_at_once_fraction": float(np.mean(right & (self.frames_needed == 1))),
            "starts_localized_wrongly": float(np.count_nonzero((self.frames_needed > 0) & ~right)),
        }
        if right.any():
            out["start_error_median_cm"] = 100 * float(np.median(self.error_m[right]))
            out["start_error_p95_cm"] = 100 * float(np.percentile(self.error_m[right], 95))
        return out


def restart_along(
    trace: Trace, T_map_true: NDArray[np.float64], stored_map: FeatureMap, every: int, prior_sigma_m: float
) -> Restarts:
    """Switch the car on at every n-th frame of a drive, knowing its place as a satellite receiver does.

    Args:
        trace: of F frames; no segmentation tells the car what moves.
        T_map_true: (F, 4, 4) true poses in the frame of the map; they make the prior, by adding an error to their
            places, and tell how well the car did.
        stored_map: to be found in.
        prior_sigma_m: standard deviation of the prior, east and north, metres; of its heading the car knows nothing.
    """
    extractor = FeatureExtractor(trace.camera)
    features, times = [], []
    for frame in trace:
        features.append(extractor.extract(frame))
        times.append(frame.timestamp)
    return restart(trace.camera, features, times, T_map_true, stored_map, every, prior_sigma_m)


def restart(
    camera: StereoCamera,
    features: Sequence[CameraFeatures],
    times: Sequence[float],
    T_map_true: NDArray[np.float64],
    stored_map: FeatureMap,
    every: int,
    prior_sigma_m: float,
    seed: int = 0,
) -> Restarts:
    """As `restart_along`, with the features (F) and times (F), seconds, of the frames; `seed` draws the errors."""
    rng = np.random.default_rng(seed)
    localizing = FeatureMap(stored_map.features[stored_map.features.described], stored_map.georeference)
    frames = np.arange(0, max(len(features) - _SOON_FRAMES, 1), every)
    needed, errors = np.zeros(len(frames), np.int64), np.full(len(frames), np.nan)
    for row, first in enumerate(frames.tolist()):
        error = np.append(rng.normal(0.0, prior_sigma_m, 2), 0.0)
        prior = (T_map_true[first, :3, 3] + error, prior_sigma_m)
        slam = StereoSlam(camera, stored_map=localizing, position_prior=prior)
        for i in range(first, min(first + _PATIENCE_FRAMES, len(features))):
            tracked = slam.track(features[i], times[i], i)
            if tracked.state is TrackingState.LOCALIZED:
                needed[row] = i - first + 1
                errors[row] = _distance_m(tracked.T_map_cam, T_map_true[i])
                break
        slam.finish()
    return Restarts(frames, needed, errors)


def _distance_m(T_a: Pose, T_b: Pose) -> float:
    return float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]))
