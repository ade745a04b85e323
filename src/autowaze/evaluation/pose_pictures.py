"""Pictures of `evaluate odometry` and `evaluate localization`: paths over the truth, errors over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.localization import localization_errors
from autowaze.evaluation.trajectory import absolute_errors, aligned_positions, relative_errors
from autowaze.evaluation.trajectory_plot import PlottedErrors, draw_trajectories
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState


@dataclass(frozen=True)
class Estimate:
    """Poses of some frames of a drive with the truth of the same frames.

    Attributes:
        timestamp: (N,) float64, seconds.
        T_world_cam, T_truth: (N, 4, 4) float64, metres; their frames need not agree.
    """

    timestamp: NDArray[np.float64]
    T_world_cam: NDArray[np.float64]
    T_truth: NDArray[np.float64]


def draw_odometry(path: Path, title: str, estimates: Mapping[str, Estimate]) -> None:
    """Paths aligned with the truth, their error per position and per frame; the truth is the first estimate's."""
    first = next(iter(estimates.values()))
    seconds = {name: e.timestamp - first.timestamp[0] for name, e in estimates.items()}
    absolute = {name: absolute_errors(e.T_world_cam, e.T_truth).errors for name, e in estimates.items()}
    relative = {name: 100 * relative_errors(e.T_world_cam, e.T_truth).errors for name, e in estimates.items()}
    positions = {name: aligned_positions(e.T_world_cam, e.T_truth) for name, e in estimates.items()}
    panels = [
        PlottedErrors("position error after alignment (APE) [m]", seconds, absolute),
        PlottedErrors("error of the motion per frame (RPE) [cm]", {n: s[1:] for n, s in seconds.items()}, relative),
    ]
    draw_trajectories(path, title, first.T_truth[:, :3, 3], positions, panels)


def draw_localization(path: Path, title: str, tracked: list[TrackedFrame], T_map_true: NDArray[np.float64]) -> None:
    """The path in the map as it was localised, not aligned, and its errors across, up and along."""
    localized = np.array([t.state is TrackingState.LOCALIZED for t in tracked])
    seconds = np.array([t.timestamp for t in tracked])
    seconds = (seconds - seconds[0])[localized]
    positions = np.stack([t.T_map_cam for t in tracked])[localized, :3, 3]
    found = localization_errors(tracked, T_map_true)
    errors = {name: 100 * values for name, values in vars(found).items() if isinstance(values, np.ndarray)}
    panels = [
        PlottedErrors(f"{name} [cm]", {"localised": seconds}, {"localised": values}) for name, values in errors.items()
    ]
    draw_trajectories(path, title, T_map_true[:, :3, 3], {"localised": positions}, panels)
