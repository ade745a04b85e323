"""Small dense algebra inside compiled loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.compiled import compiled
from autowaze.world.pose import Pose


@compiled
def solve_positive(A, b):  # type: ignore[no-untyped-def]
    """Solve A x = b in place by Cholesky; A symmetric (n, n), its upper triangle is read; b becomes x.

    Returns False, with A and b spoilt, when A is not positive definite.
    """
    n = A.shape[0]
    for j in range(n):
        if not A[j, j] > 0.0:
            return False
        pivot = np.sqrt(A[j, j])
        for i in range(j, n):
            A[j, i] /= pivot
        for k in range(j + 1, n):
            factor = A[j, k]
            if factor != 0.0:
                for i in range(k, n):
                    A[k, i] -= factor * A[j, i]
    for j in range(n):
        b[j] /= A[j, j]
        for i in range(j + 1, n):
            b[i] -= A[j, i] * b[j]
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            b[j] -= A[j, i] * b[i]
        b[j] /= A[j, j]
    return True


@compiled
def rotate_left(omega, M):  # type: ignore[no-untyped-def]
    """exp(omega) M of a rotation vector (3,) and a matrix (3, n)."""
    wx, wy, wz = omega[0], omega[1], omega[2]
    angle2 = wx * wx + wy * wy + wz * wz
    angle = np.sqrt(angle2)
    if angle < 1e-6:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    E = np.empty((3, 3))
    E[0, 0] = 1.0 - b * (wy * wy + wz * wz)
    E[0, 1] = b * wx * wy - a * wz
    E[0, 2] = b * wx * wz + a * wy
    E[1, 0] = b * wx * wy + a * wz
    E[1, 1] = 1.0 - b * (wx * wx + wz * wz)
    E[1, 2] = b * wy * wz - a * wx
    E[2, 0] = b * wx * wz - a * wy
    E[2, 1] = b * wy * wz + a * wx
    E[2, 2] = 1.0 - b * (wx * wx + wy * wy)
    out = np.empty(M.shape)
    for i in range(3):
        for j in range(M.shape[1]):
            out[i, j] = E[i, 0] * M[0, j] + E[i, 1] * M[1, j] + E[i, 2] * M[2, j]
    return out


_THRICE = 3.0 * np.eye(3)


def orthonormal(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations nearest to matrices (..., 3, 3) that rounding spoilt: one Newton step to the polar factor."""
    return np.asarray(0.5 * R @ (_THRICE - np.swapaxes(R, -1, -2) @ R))


def turned(R: NDArray[np.float64], covariance: NDArray[np.floating]) -> NDArray[np.float64]:
    """Covariance (6, 6) of position and rotation vector in the axes that a rotation (3, 3) takes its own to."""
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = R
    return np.asarray(both @ covariance @ both.T)


def then(motion: Pose, T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (..., 4, 4) after a motion (4, 4); rotations stay rotations however often this is done."""
    moved = np.asarray(motion @ T)
    moved[..., :3, :3] = orthonormal(moved[..., :3, :3])
    return moved
