"""Bundle adjustment of keyframes and landmarks: Levenberg-Marquardt on the Schur complement.

Method: Triggs et al. 2000, "Bundle adjustment: a modern synthesis"; schedule of outliers as in ORB-SLAM2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.pose_optimization import CHI2_MONO, CHI2_STEREO, _chi2, _jacobian, _pose_jacobian
from autowaze.vehicle.slam.small_matrices import orthonormal, rotate_left, solve_positive
from autowaze.vehicle.vision.compiled import compiled
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import inverse

_FIRST_ITERATIONS, _FINAL_ITERATIONS = 3, 3  # Huber, drop outliers, again without; ORB-SLAM2 takes 5 and 10
_RELATIVE_GAIN = 1e-4  # a smaller one ends the iterations


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


def adjust(problem: BundleProblem, camera: StereoCamera) -> BundleSolution:
    """Least reprojection error over all free poses and points, outliers left out.

    At least one pose or three points must be held, or the gauge drifts (the damping keeps it solvable).
    """
    order = np.lexsort((problem.keyframe, problem.point))
    start = np.searchsorted(problem.point[order], np.arange(len(problem.position) + 1))
    T = inverse(problem.T_map_cam)
    free_index = np.where(problem.pose_free, np.cumsum(problem.pose_free) - 1, -1)
    R, t, position, inlier_sorted = _adjust(
        np.ascontiguousarray(T[:, :3, :3]),
        np.ascontiguousarray(T[:, :3, 3]),
        free_index.astype(np.int64),
        problem.position.copy(),
        problem.point_free,
        start.astype(np.int64),
        problem.keyframe[order],
        problem.measured[order],
        problem.information[order],
        problem.weight[order],
        np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.bf]),
        _FIRST_ITERATIONS,
        _FINAL_ITERATIONS,
    )
    T[:, :3, :3], T[:, :3, 3] = orthonormal(R), t
    inlier = np.empty(len(order), np.bool_)
    inlier[order] = inlier_sorted
    return BundleSolution(inverse(T), position, inlier)


@compiled
def _adjust(  # type: ignore[no-untyped-def]
    R, t, free, position, point_free, start, keyframe, measured, information, weight, calibration, n_first, n_final
):
    n_observations = keyframe.shape[0]
    inlier = np.ones(n_observations, np.bool_)
    chi2 = np.empty(n_observations)
    for phase in range(2):
        robust = phase == 0
        damping = 1e-4
        cost = _cost(R, t, position, start, keyframe, measured, information, weight, calibration, inlier, robust, chi2)
        for _ in range(n_first if phase == 0 else n_final):
            new_R, new_t, new_position, solved = _step(
                R, t, free, position, point_free, start, keyframe, measured, information, weight, calibration, inlier,
                robust, damping,
            )  # fmt: skip
            new_cost = np.inf
            if solved:
                new_cost = _cost(
                    new_R, new_t, new_position, start, keyframe, measured, information, weight, calibration, inlier,
                    robust, chi2,
                )  # fmt: skip
            if new_cost <= cost:
                gain = (cost - new_cost) / max(cost, 1e-12)
                R, t, position, cost = new_R, new_t, new_position, new_cost
                damping = max(damping * 0.1, 1e-9)
                if gain < _RELATIVE_GAIN:
                    break
            else:
                damping *= 10.0
                if damping > 1e6:
                    break
        _cost(R, t, position, start, keyframe, measured, information, weight, calibration, inlier, robust, chi2)
        for i in range(n_observations):
            inlier[i] = chi2[i] <= (CHI2_STEREO if information[i, 1] > 0.0 else CHI2_MONO)
    return R, t, position, inlier


@compiled
def _cost(  # type: ignore[no-untyped-def]
    R, t, position, start, keyframe, measured, information, weight, calibration, inlier, robust, chi2
):
    """Sum of the (robust) squared errors of the inliers; fills `chi2` for all."""
    total = 0.0
    residual, point_cam = np.zeros(3), np.zeros(3)
    for p in range(position.shape[0]):
        for i in range(start[p], start[p + 1]):
            k = keyframe[i]
            error = _chi2(R[k], t[k], position[p], measured[i], information[i], calibration, residual, point_cam)
            chi2[i] = error
            if not inlier[i]:
                continue
            limit = CHI2_STEREO if information[i, 1] > 0.0 else CHI2_MONO
            if error == np.inf:
                error = 1e4 * limit
            if robust and error > limit:
                error = 2.0 * np.sqrt(limit * error) - limit
            total += weight[i] * error
    return total


@compiled
def _step(  # type: ignore[no-untyped-def]  # noqa: PLR0912, PLR0915
    R, t, free, position, point_free, start, keyframe, measured, information, weight, calibration, inlier, robust,
    damping,
):  # fmt: skip
    """One damped Gauss-Newton step: points eliminated, poses solved, points substituted back."""
    n_points, n_free = position.shape[0], np.int64(np.max(free)) + 1
    H = np.zeros((6 * n_free, 6 * n_free))
    g = np.zeros(6 * n_free)
    diagonal = np.zeros(6 * n_free)
    W = np.zeros((keyframe.shape[0], 6, 3))
    used = np.zeros(keyframe.shape[0], np.bool_)
    V_inverse = np.zeros((n_points, 3, 3))
    point_gradient = np.zeros((n_points, 3))
    solvable = np.zeros(n_points, np.bool_)
    residual, point_cam = np.zeros(3), np.zeros(3)
    J, Jp, Jx, V, Y = np.zeros((3, 3)), np.zeros((3, 6)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((6, 3))
    for p in range(n_points):
        V[:] = 0.0
        b0, b1, b2 = 0.0, 0.0, 0.0
        for i in range(start[p], start[p + 1]):
            if not inlier[i]:
                continue
            k = keyframe[i]
            error = _chi2(R[k], t[k], position[p], measured[i], information[i], calibration, residual, point_cam)
            if error == np.inf:
                continue
            scale = weight[i]
            limit = CHI2_STEREO if information[i, 1] > 0.0 else CHI2_MONO
            if robust and error > limit:
                scale *= np.sqrt(limit / error)
            w0, w2 = scale * information[i, 0], scale * information[i, 1]
            _jacobian(point_cam, calibration, J)
            if point_free[p]:
                for r in range(3):
                    for c in range(3):
                        Jx[r, c] = J[r, 0] * R[k, 0, c] + J[r, 1] * R[k, 1, c] + J[r, 2] * R[k, 2, c]
                for a in range(3):
                    for b in range(a, 3):
                        V[a, b] += w0 * (Jx[0, a] * Jx[0, b] + Jx[1, a] * Jx[1, b]) + w2 * Jx[2, a] * Jx[2, b]
                b0 += w0 * (Jx[0, 0] * residual[0] + Jx[1, 0] * residual[1]) + w2 * Jx[2, 0] * residual[2]
                b1 += w0 * (Jx[0, 1] * residual[0] + Jx[1, 1] * residual[1]) + w2 * Jx[2, 1] * residual[2]
                b2 += w0 * (Jx[0, 2] * residual[0] + Jx[1, 2] * residual[1]) + w2 * Jx[2, 2] * residual[2]
            f = free[k]
            if f < 0:
                continue
            used[i] = True
            _pose_jacobian(J, point_cam, Jp)
            for a in range(6):
                wa0, wa1, wa2 = w0 * Jp[0, a], w0 * Jp[1, a], w2 * Jp[2, a]
                g[6 * f + a] += wa0 * residual[0] + wa1 * residual[1] + wa2 * residual[2]
                for b in range(a, 6):
                    H[6 * f + a, 6 * f + b] += wa0 * Jp[0, b] + wa1 * Jp[1, b] + wa2 * Jp[2, b]
                if point_free[p]:
                    for c in range(3):
                        W[i, a, c] = wa0 * Jx[0, c] + wa1 * Jx[1, c] + wa2 * Jx[2, c]
        point_gradient[p, 0], point_gradient[p, 1], point_gradient[p, 2] = b0, b1, b2
        if point_free[p]:
            solvable[p] = _invert_damped(V, damping, V_inverse[p])
    for a in range(6 * n_free):
        diagonal[a] = H[a, a]
    for p in range(n_points):
        if not solvable[p]:
            continue
        for i in range(start[p], start[p + 1]):
            if not used[i]:
                continue
            f = 6 * free[keyframe[i]]
            for a in range(6):
                for c in range(3):
                    Y[a, c] = (
                        W[i, a, 0] * V_inverse[p, 0, c]
                        + W[i, a, 1] * V_inverse[p, 1, c]
                        + W[i, a, 2] * V_inverse[p, 2, c]
                    )
                g[f + a] -= (
                    Y[a, 0] * point_gradient[p, 0] + Y[a, 1] * point_gradient[p, 1] + Y[a, 2] * point_gradient[p, 2]
                )
            for j in range(i, start[p + 1]):
                if not used[j]:
                    continue
                h = 6 * free[keyframe[j]]
                for a in range(6):
                    for b in range(6):
                        H[f + a, h + b] -= Y[a, 0] * W[j, b, 0] + Y[a, 1] * W[j, b, 1] + Y[a, 2] * W[j, b, 2]
    step = -g
    for a in range(6 * n_free):
        H[a, a] += damping * diagonal[a] + 1e-9
    if n_free > 0 and not solve_positive(H, step):
        return R, t, position, False
    new_R, new_t, new_position = R.copy(), t.copy(), position.copy()
    for k in range(R.shape[0]):
        if free[k] >= 0:
            delta = step[6 * free[k] : 6 * free[k] + 6]
            new_R[k] = rotate_left(delta[3:], R[k])
            new_t[k] = rotate_left(delta[3:], t[k].reshape(3, 1)).reshape(3) + delta[:3]
    back = np.zeros(3)
    for p in range(n_points):
        if not solvable[p]:
            continue
        back[:] = -point_gradient[p]
        for i in range(start[p], start[p + 1]):
            if used[i]:
                f = 6 * free[keyframe[i]]
                for a in range(6):
                    for c in range(3):
                        back[c] -= W[i, a, c] * step[f + a]
        for c in range(3):
            new_position[p, c] += (
                V_inverse[p, c, 0] * back[0] + V_inverse[p, c, 1] * back[1] + V_inverse[p, c, 2] * back[2]
            )
    return new_R, new_t, new_position, True


@compiled
def _invert_damped(V, damping, out):  # type: ignore[no-untyped-def]
    """Inverse of V (3, 3; upper triangle) with its diagonal raised by `damping`; False when it is singular."""
    a, b, c = V[0, 0] * (1.0 + damping), V[0, 1], V[0, 2]
    d, e, f = V[1, 1] * (1.0 + damping), V[1, 2], V[2, 2] * (1.0 + damping)
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * A + b * B + c * C
    if not determinant > 1e-12 * a * d * f or determinant <= 0.0:
        return False
    out[0, 0], out[0, 1], out[0, 2] = A / determinant, B / determinant, C / determinant
    out[1, 0], out[1, 1], out[1, 2] = out[0, 1], (a * f - c * c) / determinant, (b * c - a * e) / determinant
    out[2, 0], out[2, 1], out[2, 2] = out[0, 2], out[1, 2], (a * d - b * b) / determinant
    return True
