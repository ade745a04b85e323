"""Normal equations of a bundle adjustment, landmarks eliminated (Schur complement), as compiled loops.

Poses are numbered in the order of the observations of each landmark; blocks of the reduced system are kept where two
poses see a landmark together, so that the same loops serve a few keyframes and a whole drive.
"""

from __future__ import annotations

import numpy as np

from autowaze.vehicle.slam.pose_optimization import CHI2_MONO, CHI2_STEREO, _chi2, _jacobian, _pose_jacobian
from autowaze.vehicle.slam.small_matrices import rotate_left
from autowaze.vehicle.vision.compiled import compiled


@compiled
def reprojection_cost(  # type: ignore[no-untyped-def]
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
def shared_blocks(free, start, keyframe, n_free):  # type: ignore[no-untyped-def]
    """Number of the block (row <= column) of each two free poses that see a landmark together (F, F), -1 for none.

    Returns also how many blocks there are; every free pose has one with itself.
    """
    block = np.full((n_free, n_free), -1, np.int32)
    for f in range(n_free):
        block[f, f] = 0
    for p in range(start.shape[0] - 1):
        for i in range(start[p], start[p + 1]):
            f = free[keyframe[i]]
            if f < 0:
                continue
            for j in range(i, start[p + 1]):
                h = free[keyframe[j]]
                if h >= 0:
                    block[f, h] = 0
    n = np.int32(0)
    for f in range(n_free):
        for h in range(f, n_free):
            if block[f, h] == 0:
                block[f, h] = n
                n += np.int32(1)
    return block, n


@compiled
def eliminate_landmarks(  # type: ignore[no-untyped-def]  # noqa: PLR0912, PLR0915
    R, t, free, position, point_free, start, keyframe, measured, information, weight, calibration, inlier, robust,
    damping, block, n_blocks,
):  # fmt: skip
    """The system of the free poses alone, and what it takes to find the landmarks afterwards.

    Returns H (blocks, 6, 6) and g (6 F) of the reduced system, the diagonal (6 F) before the reduction, and per
    observation its pose-landmark block W (M, 6, 3) and whether it counts; per landmark its inverse block, gradient
    and whether it can be solved.
    """
    n_points, n_free = position.shape[0], block.shape[0]
    H = np.zeros((n_blocks, 6, 6))
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
            own = block[f, f]
            _pose_jacobian(J, point_cam, Jp)
            for a in range(6):
                wa0, wa1, wa2 = w0 * Jp[0, a], w0 * Jp[1, a], w2 * Jp[2, a]
                g[6 * f + a] += wa0 * residual[0] + wa1 * residual[1] + wa2 * residual[2]
                for b in range(a, 6):
                    H[own, a, b] += wa0 * Jp[0, b] + wa1 * Jp[1, b] + wa2 * Jp[2, b]
                if point_free[p]:
                    for c in range(3):
                        W[i, a, c] = wa0 * Jx[0, c] + wa1 * Jx[1, c] + wa2 * Jx[2, c]
        point_gradient[p, 0], point_gradient[p, 1], point_gradient[p, 2] = b0, b1, b2
        if point_free[p]:
            solvable[p] = _invert_damped(V, damping, V_inverse[p])
    for f in range(n_free):
        for a in range(6):
            diagonal[6 * f + a] = H[block[f, f], a, a]
    for p in range(n_points):
        if not solvable[p]:
            continue
        for i in range(start[p], start[p + 1]):
            if not used[i]:
                continue
            f = free[keyframe[i]]
            for a in range(6):
                for c in range(3):
                    Y[a, c] = (
                        W[i, a, 0] * V_inverse[p, 0, c]
                        + W[i, a, 1] * V_inverse[p, 1, c]
                        + W[i, a, 2] * V_inverse[p, 2, c]
                    )
                g[6 * f + a] -= (
                    Y[a, 0] * point_gradient[p, 0] + Y[a, 1] * point_gradient[p, 1] + Y[a, 2] * point_gradient[p, 2]
                )
            for j in range(i, start[p + 1]):
                if not used[j]:
                    continue
                both = block[f, free[keyframe[j]]]
                for a in range(6):
                    for b in range(6):
                        H[both, a, b] -= Y[a, 0] * W[j, b, 0] + Y[a, 1] * W[j, b, 1] + Y[a, 2] * W[j, b, 2]
    return H, g, diagonal, W, used, V_inverse, point_gradient, solvable


@compiled
def substitute_back(  # type: ignore[no-untyped-def]
    R, t, free, position, start, keyframe, step, W, used, V_inverse, point_gradient, solvable
):
    """Poses and landmarks after a step (6 F) of the free poses."""
    n_points = position.shape[0]
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
    return new_R, new_t, new_position


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
