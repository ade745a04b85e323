"""Pose of one camera from landmarks whose positions are held (ORB-SLAM2, motion-only bundle adjustment)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.reprojection import add_to_pose, in_camera, limit_of, residuals, told_of_point
from autowaze.vehicle.slam.small_matrices import orthonormal, rotate_left, solve_positive, turned
from autowaze.vehicle.vision.compiled import compiled
from autowaze.world.camera import StereoCamera
from autowaze.world.pose import Pose, inverse, make_pose

_ROUNDS, _ITERATIONS = 4, 10
_ROBUST_ROUNDS = 2
_REGULAR = 1e-9 * np.eye(6)
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
        T[None, :3, :3].copy(),
        T[None, :3, 3].copy(),
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
    cov = turned(R_map_cam, np.linalg.inv(H + _REGULAR))
    return np.asarray(0.5 * (cov + cov.T))


@compiled
def _along_ray(R, depth_error, i, a00, a02, a11, a12, a22, b0, b1, b2):  # type: ignore[no-untyped-def]
    """What remains of an observation whose landmark may move along its ray (Sherman-Morrison).

    Returns A as (xx, xy, xz, yy, yz, zz), J' Lambda r (3), and by how much its squared error is less.
    """
    u, v, w = depth_error[i, 0], depth_error[i, 1], depth_error[i, 2]
    e0 = R[0, 0, 0] * u + R[0, 0, 1] * v + R[0, 0, 2] * w
    e1 = R[0, 1, 0] * u + R[0, 1, 1] * v + R[0, 1, 2] * w
    e2 = R[0, 2, 0] * u + R[0, 2, 1] * v + R[0, 2, 2] * w
    f0, f1, f2 = a00 * e0 + a02 * e2, a11 * e1 + a12 * e2, a02 * e0 + a12 * e1 + a22 * e2
    share = 1.0 / (1.0 + e0 * f0 + e1 * f1 + e2 * f2)
    along = e0 * b0 + e1 * b1 + e2 * b2
    h0, h1, h2, less = share * f0, share * f1, share * f2, share * along
    return (
        a00 - h0 * f0, -h0 * f1, a02 - h0 * f2, a11 - h1 * f1, a12 - h1 * f2, a22 - h2 * f2,
        b0 - less * f0, b1 - less * f1, b2 - less * f2, less * along,
    )  # fmt: skip


@compiled
def _optimize(R, t, position, depth_error, measured, information, weight, calibration, n_rounds):  # type: ignore[no-untyped-def]  # noqa: PLR0912
    n = position.shape[0]
    inlier = np.ones(n, np.bool_)
    chi2 = np.zeros(n)
    H, g = np.zeros((1, 6, 6)), np.zeros(6)
    for rounds in range(n_rounds):
        for _ in range(_ITERATIONS):
            H[:] = 0.0
            g[:] = 0.0
            for i in range(n):
                if not inlier[i] or weight[i] == 0.0:
                    continue
                x, y, z = in_camera(R, t, 0, position, i)
                ru, rv, rd, error = residuals(x, y, z, calibration, measured, information, i)
                if error == np.inf:
                    continue
                told = told_of_point(x, y, z, ru, rv, rd, information[i, 0], information[i, 1], calibration)
                a00, a01, a02, a11, a12, a22, b0, b1, b2, less = _along_ray(R, depth_error, i, *told)
                error -= less
                limit = limit_of(information, i)
                w = weight[i]
                if rounds < _ROBUST_ROUNDS and error > limit:
                    w *= np.sqrt(limit / error)
                add_to_pose(
                    H, g, 0, 0, x, y, z, w * a00, w * a01, w * a02, w * a11, w * a12, w * a22, w * b0, w * b1, w * b2
                )
            step, A = -g, H[0].copy()
            for a in range(6):
                A[a, a] += 1e-9 * (1.0 + A[a, a])
            if not solve_positive(A, step):
                break
            R[0] = rotate_left(step[3:], R[0])
            t[0] = rotate_left(step[3:], t[0].reshape(3, 1)).reshape(3) + step[:3]
            if np.max(np.abs(step)) < _CONVERGED:
                break
        settled = rounds >= _ROBUST_ROUNDS
        for i in range(n):
            x, y, z = in_camera(R, t, 0, position, i)
            ru, rv, rd, error = residuals(x, y, z, calibration, measured, information, i)
            if error != np.inf:
                told = told_of_point(x, y, z, ru, rv, rd, information[i, 0], information[i, 1], calibration)
                error -= _along_ray(R, depth_error, i, *told)[9]
            chi2[i] = error
            agrees = error <= limit_of(information, i)
            settled = settled and agrees == inlier[i]
            inlier[i] = agrees
        if settled:
            break
    for a in range(6):
        for b in range(a):
            H[0, a, b] = H[0, b, a]
    return R[0], t[0], inlier, chi2, H[0]
