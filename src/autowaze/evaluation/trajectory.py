"""Errors of a trajectory against the truth: APE after alignment and RPE per frame, as evo computes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import AutowazeError
from autowaze.world.pose import Pose, inverse, make_pose, transform


@dataclass(frozen=True)
class ErrorSummary:
    """Statistics of errors (N,) in metres."""

    errors: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Mean, m."""
        return float(np.mean(self.errors))

    @property
    def median(self) -> float:
        """Median, m."""
        return float(np.median(self.errors))

    @property
    def rmse(self) -> float:
        """Root of the mean square, m."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def max(self) -> float:
        """Largest, m."""
        return float(np.max(self.errors))


def align(positions: NDArray[np.float64], truth: NDArray[np.float64]) -> Pose:
    """Rigid motion (4, 4), without scale, that takes positions (N, 3) nearest to the truth (N, 3) in the mean square.

    Source: Umeyama 1991, "Least-squares estimation of transformation parameters between two point patterns".
    """
    centre, centre_truth = positions.mean(axis=0), truth.mean(axis=0)
    U, _, Vt = np.linalg.svd((truth - centre_truth).T @ (positions - centre))
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = U @ sign @ Vt
    return make_pose(R, centre_truth - R @ centre)


def absolute_errors(
    T_estimate: NDArray[np.float64], T_truth: NDArray[np.float64], aligned: bool = True
) -> ErrorSummary:
    """Absolute position errors (APE, translation part) of poses (N, 4, 4) in any two fixed frames.

    Args:
        T_estimate, T_truth: camera-to-world poses of the same frames, metres.
        aligned: whether the estimate is first moved rigidly as a whole onto the truth.
    """
    _check(T_estimate, T_truth)
    positions = aligned_positions(T_estimate, T_truth) if aligned else T_estimate[:, :3, 3]
    return ErrorSummary(np.linalg.norm(positions - T_truth[:, :3, 3], axis=1))


def aligned_positions(T_estimate: NDArray[np.float64], T_truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (N, 3) of an estimate that is moved rigidly as a whole onto the truth, in the frame of the truth."""
    positions = T_estimate[:, :3, 3]
    return transform(align(positions, T_truth[:, :3, 3]), positions)


def relative_errors(T_estimate: NDArray[np.float64], T_truth: NDArray[np.float64], step: int = 1) -> ErrorSummary:
    """Relative position errors (RPE, translation part) over `step` frames, from every frame on.

    Args:
        T_estimate, T_truth: camera-to-world poses (N, 4, 4) of the same frames, metres; frames need not agree.
        step: frames between the two ends of each motion.
    """
    _check(T_estimate, T_truth)
    moved = inverse(T_estimate[:-step]) @ T_estimate[step:]
    moved_truth = inverse(T_truth[:-step]) @ T_truth[step:]
    return ErrorSummary(np.linalg.norm((inverse(moved_truth) @ moved)[:, :3, 3], axis=1))


def trajectory_metrics(T_estimate: NDArray[np.float64], T_truth: NDArray[np.float64]) -> dict[str, float]:
    """Flat names for reports, of poses (N, 4, 4) of the same frames.

    `drift_percent`: how far the last place is off, as seen from the first pose, of the distance.
    """
    relative, absolute = relative_errors(T_estimate, T_truth), absolute_errors(T_estimate, T_truth)
    distance_m = float(np.linalg.norm(np.diff(T_truth[:, :3, 3], axis=0), axis=1).sum())
    end_m = relative_errors(T_estimate, T_truth, len(T_truth) - 1).mean
    return {
        "frames": float(len(T_truth)),
        "distance_m": distance_m,
        "drift_percent": 100 * end_m / max(distance_m, 1e-9),
        "rpe_mean_cm": 100 * relative.mean,
        "ape_rmse_m": absolute.rmse,
        "ape_max_m": absolute.max,
    }


def _check(T_estimate: NDArray[np.float64], T_truth: NDArray[np.float64]) -> None:
    if T_estimate.shape != T_truth.shape or len(T_estimate) < 3:
        raise AutowazeError(
            f"trajectories of {len(T_estimate)} and {len(T_truth)} poses: give the poses of the same frames, at least 3"
        )
