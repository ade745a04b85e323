"""Pose of one camera from landmarks whose positions are held (ORB-SLAM2, motion-only bundle adjustment)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.small_matrices import orthonormal, rotate_left, solve_positive
from autowaze.vehicle.vision.compiled import compiled
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import Pose, inverse, make_pose

CHI2_MONO = 5.991  # 95 % of chi squared with 2 degrees of freedom
CHI2_STEREO = 7.815  # and with 3
_ROUNDS, _ITERATIONS = 4, 10
_ROBUST_ROUNDS = 2
_CONVERGED = 1e-4  # m and rad: a tenth of what the data can tell


@dataclass(frozen=True)
class PoseEstimate:
    """Result of a pose-only adjustment.

    Attributes:
        T_map_cam: (4, 4).
        covariance: (6, 6), position (m) and rotation vector (rad) in the map frame.
        inlier: (M,) bool, observations that agree with the pose.
        chi2: (M,) float64, squared error of each over its variance.
    """

    T_map_cam: Pose
    covariance: NDArray[np.float64]
    inlier: NDArray[np.bool_]
    chi2: NDArray[np.float64]


def optimize_pose(
    T_map_cam: Pose,
    position: NDArray[np.float64],
    measured: NDArray[np.float64],
    information: NDArray[np.float64],
    weight: NDArray[np.float64],
    camera: StereoCamera,
    depth_error: NDArray[np.float64] | None = None,
    rounds: int = _ROUNDS,
) -> PoseEstimate:
    """Gauss-Newton with Huber weights, outliers told apart anew each round.

    A landmark's depth is known less well than its direction: its error is marginalised out of each observation, so
    that fresh and far landmarks tell the camera's orientation and leave its position to the others.

    Args:
        T_map_cam: where to start.
        position: (M, 3) landmarks in the map frame, m.
        measured: (M, 3) u, v, disparity in pixels; disparity NaN without stereo.
        information: (M, 2) inverse variances of u and v, and of the disparity (0 without stereo).
        weight: (M,) how much each counts; 0 to be judged but not to steer.
        camera: calibration.
        depth_error: (M, 3) standard deviation of each landmark along the ray on which it was seen, as a vector in the
            map frame, m; none by default.
        rounds: of telling outliers apart; the first two weigh them down, the others leave them out.
    """
    T = inverse(T_map_cam)
    depth_error = np.zeros_like(position) if depth_error is None else depth_error
    calibration = np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.bf])
    R, t, inlier, chi2, H = _optimize(
        np.ascontiguousarray(T[:3, :3]),
        T[:3, 3].copy(),
        position,
        depth_error,
        measured,
        information,
        weight,
        calibration,
        rounds,
    )
    T_new = inverse(make_pose(orthonormal(R), t))
    return PoseEstimate(T_new, _covariance(H, T_new[:3, :3]), inlier, chi2)


def _covariance(H: NDArray[np.float64], R_map_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """From the information of a perturbation in the camera frame to position and rotation in the map frame."""
    to_map = np.kron(np.eye(2), R_map_cam)
    cov = to_map @ np.linalg.inv(H + 1e-9 * np.eye(6)) @ to_map.T
    return np.asarray(0.5 * (cov + cov.T))


@compiled
def _chi2(R, t, p, z, information, calibration, residual, point_cam):  # type: ignore[no-untyped-def]
    """Squared error over variance of one observation; fills `residual` (3) and `point_cam` (3)."""
    for i in range(3):
        point_cam[i] = R[i, 0] * p[0] + R[i, 1] * p[1] + R[i, 2] * p[2] + t[i]
    depth = point_cam[2]
    if depth < 0.05:
        return np.inf
    residual[0] = calibration[0] * point_cam[0] / depth + calibration[2] - z[0]
    residual[1] = calibration[1] * point_cam[1] / depth + calibration[3] - z[1]
    chi2 = information[0] * (residual[0] ** 2 + residual[1] ** 2)
    residual[2] = 0.0
    if information[1] > 0.0:
        residual[2] = calibration[4] / depth - z[2]
        chi2 += information[1] * residual[2] ** 2
    return chi2


@compiled
def _jacobian(point_cam, calibration, J):  # type: ignore[no-untyped-def]
    """Of u, v, disparity by the point in the camera frame; fills J (3, 3)."""
    x, y, z = point_cam[0], point_cam[1], point_cam[2]
    J[:] = 0.0
    J[0, 0] = calibration[0] / z
    J[0, 2] = -calibration[0] * x / (z * z)
    J[1, 1] = calibration[1] / z
    J[1, 2] = -calibration[1] * y / (z * z)
    J[2, 2] = -calibration[4] / (z * z)


@compiled
def _pose_jacobian(J, point_cam, Jp):  # type: ignore[no-untyped-def]
    """Of u, v, disparity by a small motion (translation, rotation) of the camera frame; fills Jp (3, 6)."""
    x, y, z = point_cam[0], point_cam[1], point_cam[2]
    for r in range(3):
        a, b, c = J[r, 0], J[r, 1], J[r, 2]
        Jp[r, 0], Jp[r, 1], Jp[r, 2] = a, b, c
        Jp[r, 3] = c * y - b * z
        Jp[r, 4] = a * z - c * x
        Jp[r, 5] = b * x - a * y


@compiled
def _marginal(R, J, depth_error, information, residual, W, Wr):  # type: ignore[no-untyped-def]
    """Squared error of an observation whose landmark may move along its ray (Sherman-Morrison).

    Fills the upper triangle of W (3, 3), the information that remains, and Wr (3), that times the residual.
    """
    iu, id_ = information[0], information[1]
    e0 = R[0, 0] * depth_error[0] + R[0, 1] * depth_error[1] + R[0, 2] * depth_error[2]
    e1 = R[1, 0] * depth_error[0] + R[1, 1] * depth_error[1] + R[1, 2] * depth_error[2]
    e2 = R[2, 0] * depth_error[0] + R[2, 1] * depth_error[1] + R[2, 2] * depth_error[2]
    a0 = J[0, 0] * e0 + J[0, 2] * e2
    a1 = J[1, 1] * e1 + J[1, 2] * e2
    a2 = J[2, 2] * e2
    share = 1.0 / (1.0 + iu * (a0 * a0 + a1 * a1) + id_ * a2 * a2)
    W[0, 0] = iu - iu * a0 * a0 * iu * share
    W[0, 1] = -iu * a0 * a1 * iu * share
    W[0, 2] = -iu * a0 * a2 * id_ * share
    W[1, 1] = iu - iu * a1 * a1 * iu * share
    W[1, 2] = -iu * a1 * a2 * id_ * share
    W[2, 2] = id_ - id_ * a2 * a2 * id_ * share
    r0, r1, r2 = residual[0], residual[1], residual[2]
    Wr[0] = W[0, 0] * r0 + W[0, 1] * r1 + W[0, 2] * r2
    Wr[1] = W[0, 1] * r0 + W[1, 1] * r1 + W[1, 2] * r2
    Wr[2] = W[0, 2] * r0 + W[1, 2] * r1 + W[2, 2] * r2
    return r0 * Wr[0] + r1 * Wr[1] + r2 * Wr[2]


@compiled
def _optimize(R, t, position, depth_error, measured, information, weight, calibration, n_rounds):  # type: ignore[no-untyped-def]  # noqa: PLR0912
    n = position.shape[0]
    inlier = np.ones(n, np.bool_)
    chi2 = np.zeros(n)
    H, g = np.zeros((6, 6)), np.zeros(6)
    residual, point_cam, J, Jp = np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros((3, 6))
    W, Wr = np.zeros((3, 3)), np.zeros(3)
    for rounds in range(n_rounds):
        for _ in range(_ITERATIONS):
            H[:] = 0.0
            g[:] = 0.0
            for i in range(n):
                if not inlier[i] or weight[i] == 0.0:
                    continue
                error = _chi2(R, t, position[i], measured[i], information[i], calibration, residual, point_cam)
                if error == np.inf:
                    continue
                _jacobian(point_cam, calibration, J)
                error = _marginal(R, J, depth_error[i], information[i], residual, W, Wr)
                limit = CHI2_STEREO if information[i, 1] > 0.0 else CHI2_MONO
                robust = weight[i]
                if rounds < _ROBUST_ROUNDS and error > limit:
                    robust *= np.sqrt(limit / error)
                _pose_jacobian(J, point_cam, Jp)
                for a in range(6):
                    g[a] += robust * (Jp[0, a] * Wr[0] + Jp[1, a] * Wr[1] + Jp[2, a] * Wr[2])
                    w0 = robust * (W[0, 0] * Jp[0, a] + W[0, 1] * Jp[1, a] + W[0, 2] * Jp[2, a])
                    w1 = robust * (W[0, 1] * Jp[0, a] + W[1, 1] * Jp[1, a] + W[1, 2] * Jp[2, a])
                    w2 = robust * (W[0, 2] * Jp[0, a] + W[1, 2] * Jp[1, a] + W[2, 2] * Jp[2, a])
                    for b in range(a, 6):
                        H[a, b] += w0 * Jp[0, b] + w1 * Jp[1, b] + w2 * Jp[2, b]
            step, A = -g, H.copy()
            for a in range(6):
                A[a, a] += 1e-9 * (1.0 + A[a, a])
            if not solve_positive(A, step):
                break
            R = rotate_left(step[3:], R)
            t = rotate_left(step[3:], t.reshape(3, 1)).reshape(3) + step[:3]
            if np.max(np.abs(step)) < _CONVERGED:
                break
        for i in range(n):
            chi2[i] = _chi2(R, t, position[i], measured[i], information[i], calibration, residual, point_cam)
            if chi2[i] != np.inf:
                _jacobian(point_cam, calibration, J)
                chi2[i] = _marginal(R, J, depth_error[i], information[i], residual, W, Wr)
            inlier[i] = chi2[i] <= (CHI2_STEREO if information[i, 1] > 0.0 else CHI2_MONO)
    for a in range(6):
        for b in range(a):
            H[a, b] = H[b, a]
    return R, t, inlier, chi2, H
