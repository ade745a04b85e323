"""Bundle adjustment of keyframes and landmarks: Levenberg-Marquardt on the Schur complement.

Method: Triggs et al. 2000, "Bundle adjustment: a modern synthesis"; schedule of outliers as in ORB-SLAM2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags, triu
from scipy.sparse.linalg import splu

from autowaze.vehicle.slam.normal_equations import (
    eliminate_landmarks,
    reprojection_cost,
    shared_blocks,
    substitute_back,
)
from autowaze.vehicle.slam.reprojection import CHI2_MONO, CHI2_STEREO
from autowaze.vehicle.slam.small_matrices import orthonormal, solve_positive
from autowaze.vehicle.vision.compiled import compiled
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import inverse

_ITERATIONS = 3  # with Huber's cost, and again without the outliers; ORB-SLAM2 takes 5 and 10
_MAX_DENSE = 30  # poses
COARSE, FINE = 1e-3, 1e-4  # relative gain of an iteration below which there is no next one


@dataclass(frozen=True)
class BundleProblem:
    """Keyframes, landmarks and who saw what.

    Attributes:
        T_map_cam: (K, 4, 4) keyframe poses. pose_free: (K,) bool.
        position: (P, 3) landmarks in the map frame, m. point_free: (P,) bool.
        keyframe, point: (M,) int64, rows of the above, per observation.
        measured: (M, 3) u, v, disparity in pixels; disparity NaN without stereo.
        information: (M, 2) inverse variances of u and v, and of the disparity (0 without stereo), with any weights.
    """

    T_map_cam: NDArray[np.float64]
    pose_free: NDArray[np.bool_]
    position: NDArray[np.float64]
    point_free: NDArray[np.bool_]
    keyframe: NDArray[np.int64]
    point: NDArray[np.int64]
    measured: NDArray[np.float64]
    information: NDArray[np.float64]
    weight: NDArray[np.float64]


@dataclass(frozen=True)
class BundleSolution:
    """Adjusted poses (K, 4, 4), positions (P, 3), and which observations (M,) agree with them."""

    T_map_cam: NDArray[np.float64]
    position: NDArray[np.float64]
    inlier: NDArray[np.bool_]


_State = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]  # R, t of the cameras, landmarks


@dataclass(frozen=True)
class _Observations:
    """Sorted by landmark, then by keyframe; `start` (P + 1) says where those of each landmark begin."""

    free: NDArray[np.int64]
    point_free: NDArray[np.bool_]
    start: NDArray[np.int64]
    keyframe: NDArray[np.int64]
    measured: NDArray[np.float64]
    information: NDArray[np.float64]
    weight: NDArray[np.float64]
    calibration: NDArray[np.float64]


def adjust(
    problem: BundleProblem, camera: StereoCamera, max_iterations: int = _ITERATIONS, least_gain: float = COARSE
) -> BundleSolution:
    """Least reprojection error over all free poses and points, outliers left out.

    At least one pose or three points must be held, or the gauge drifts (the damping keeps it solvable). The poses of a
    few keyframes are solved for as one dense system; those of a whole drive as a sparse one.

    Args:
        problem: what was seen from where.
        camera: calibration.
        max_iterations: in each of two rounds, the first with Huber's cost, the second without the outliers.
        least_gain: share of the cost that an iteration must save for another one to follow; what is soon adjusted again
            with more keyframes needs no last digits.
    """
    order, start = _by_landmark(problem.keyframe, problem.point, len(problem.T_map_cam), len(problem.position))
    T = inverse(problem.T_map_cam)
    free = np.where(problem.pose_free, np.cumsum(problem.pose_free) - 1, -1).astype(np.int64)
    seen = _Observations(
        free=free,
        point_free=problem.point_free,
        start=start,
        keyframe=problem.keyframe[order],
        measured=problem.measured[order],
        information=problem.information[order],
        weight=problem.weight[order],
        calibration=np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.bf]),
    )
    state = (np.ascontiguousarray(T[:, :3, :3]), np.ascontiguousarray(T[:, :3, 3]), problem.position.copy())
    inlier_sorted = np.ones(len(order), np.bool_)
    for robust in (True, False):
        state, chi2 = _minimise(state, seen, inlier_sorted, robust, max_iterations, least_gain)
        inlier_sorted = chi2 <= np.where(seen.information[:, 1] > 0.0, CHI2_STEREO, CHI2_MONO)
    T[:, :3, :3], T[:, :3, 3] = orthonormal(state[0]), state[1]
    inlier = np.empty(len(order), np.bool_)
    inlier[order] = inlier_sorted
    return BundleSolution(inverse(T), state[2], inlier)


def _cost(
    state: _State, seen: _Observations, inlier: NDArray[np.bool_], robust: bool
) -> tuple[float, NDArray[np.float64]]:
    """Sum of squared errors, and each (M,)."""
    chi2 = np.empty(len(inlier))
    total = reprojection_cost(
        *state, seen.start, seen.keyframe, seen.measured, seen.information, seen.weight, seen.calibration, inlier,
        robust, chi2,
    )  # fmt: skip
    return float(total), chi2


def _minimise(
    state: _State,
    seen: _Observations,
    inlier: NDArray[np.bool_],
    robust: bool,
    max_iterations: int,
    least_gain: float,
) -> tuple[_State, NDArray[np.float64]]:
    """Levenberg-Marquardt; returns also the squared errors (M,) of what it found."""
    block, n_blocks = shared_blocks(seen.free, seen.start, seen.keyframe, int(seen.free.max()) + 1)
    W = np.empty((len(inlier), 3, 6))
    damping, (cost, chi2) = 1e-4, _cost(state, seen, inlier, robust)
    for _ in range(max_iterations):
        R, t, position = state
        H, g, diagonal, *landmarks = eliminate_landmarks(
            R, t, seen.free, position, seen.point_free, seen.start, seen.keyframe, seen.measured, seen.information,
            seen.weight, seen.calibration, inlier, robust, damping, block, n_blocks, W,
        )  # fmt: skip
        step = _solve(H, block, -g, damping * diagonal + 1e-9)
        new_cost = np.inf
        if step is not None:
            new = substitute_back(R, t, seen.free, position, seen.start, seen.keyframe, step, W, *landmarks)
            new_cost, new_chi2 = _cost(new, seen, inlier, robust)
        if new_cost <= cost:
            gain = (cost - new_cost) / max(cost, 1e-12)
            state, cost, chi2 = new, new_cost, new_chi2
            damping = max(damping * 0.1, 1e-9)
            if gain < least_gain:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return state, chi2


def _solve(
    H: NDArray[np.float64], block: NDArray[np.int32], right: NDArray[np.float64], damping: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Step of the poses, or None where the system is not positive definite."""
    if len(block) > _MAX_DENSE:
        return _solve_sparse(H, block, right, damping)
    dense = _dense(H, block)
    dense[np.diag_indices(len(right))] += damping
    return right if solve_positive(dense, right) else None


def _solve_sparse(
    H: NDArray[np.float64], block: NDArray[np.int32], right: NDArray[np.float64], damping: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    f, h = np.nonzero(block >= 0)
    values = H[block[f, h]]
    row = np.broadcast_to(6 * f[:, None, None] + np.arange(6)[:, None], values.shape)
    column = np.broadcast_to(6 * h[:, None, None] + np.arange(6), values.shape)
    upper = column >= row
    A = coo_matrix((values[upper], (row[upper], column[upper])), shape=(len(right), len(right))).tocsc()
    A = A + triu(A, 1).T + diags(damping)
    try:
        step = splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(right)
    except RuntimeError:  # exactly singular
        return None
    return np.asarray(step) if np.isfinite(step).all() else None


@compiled
def _by_landmark(keyframe, point, n_keyframes, n_points):  # type: ignore[no-untyped-def]
    """Observations (M,) sorted by landmark, then by keyframe, and where each landmark begins (P + 1); by counting."""
    order = np.arange(keyframe.shape[0])
    start = np.zeros(1, np.int64)
    for key, n in ((keyframe, n_keyframes), (point, n_points)):
        start = np.zeros(n + 1, np.int64)
        for k in key:
            start[k + 1] += 1
        start = np.cumsum(start)
        free, sorted_ = start.copy(), np.empty_like(order)
        for i in order:
            sorted_[free[key[i]]] = i
            free[key[i]] += 1
        order = sorted_
    return order, start


@compiled
def _dense(H, block):  # type: ignore[no-untyped-def]
    """Upper triangle of the reduced system (6 F, 6 F)."""
    n = block.shape[0]
    dense = np.zeros((6 * n, 6 * n))
    for f in range(n):
        for h in range(f, n):
            if block[f, h] >= 0:
                dense[6 * f : 6 * f + 6, 6 * h : 6 * h + 6] = H[block[f, h]]
    return dense
