"""Normal equations of a bundle adjustment, landmarks eliminated (Schur complement), as compiled loops.

Poses are numbered in the order of the observations of each landmark; blocks of the reduced system are kept where two
poses see a landmark together, so that the same loops serve a few keyframes and a whole drive.
"""

from __future__ import annotations

import numpy as np

from autowaze.vehicle.slam.reprojection import add_to_pose, in_camera, limit_of, residuals, told_of_point
from autowaze.vehicle.slam.small_matrices import rotate_left
from autowaze.vehicle.vision.compiled import compiled


@compiled
def reprojection_cost(  # type: ignore[no-untyped-def]
    R, t, position, start, keyframe, measured, information, weight, calibration, inlier, robust, chi2
):
    """Sum of the (robust) squared errors of the inliers; fills `chi2` for all."""
    total = 0.0
    for p in range(position.shape[0]):
        for i in range(start[p], start[p + 1]):
            x, y, z = in_camera(R, t, keyframe[i], position, p)
            error = residuals(x, y, z, calibration, measured, information, i)[3]
            chi2[i] = error
            if not inlier[i]:
                continue
            limit = limit_of(information, i)
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
def eliminate_landmarks(  # type: ignore[no-untyped-def]  # noqa: PLR0915
    R, t, free, position, point_free, start, keyframe, measured, information, weight, calibration, inlier, robust,
    damping, block, n_blocks, W,
):  # fmt: skip
    """The system of the free poses alone, and what it takes to find the landmarks afterwards.

    Fills W (M, 3, 6), the landmark-pose block of each observation: fresh memory for it in each iteration would cost a
    quarter of the time. Returns H (blocks, 6, 6) and g (6 F) of the reduced system, the diagonal (6 F) before the
    reduction, and per observation whether it counts; per landmark its inverse block, gradient and whether it can be
    solved.
    """
    n_points, n_free = position.shape[0], block.shape[0]
    H, g = np.zeros((n_blocks, 6, 6)), np.zeros(6 * n_free)
    used = np.zeros(keyframe.shape[0], np.bool_)
    V_inverse = np.zeros((n_points, 3, 3))
    point_gradient = np.zeros((n_points, 3))
    solvable = np.zeros(n_points, np.bool_)
    for p in range(n_points):
        g0, g1, g2 = 0.0, 0.0, 0.0
        v00, v01, v02, v11, v12, v22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        is_free = point_free[p]
        for i in range(start[p], start[p + 1]):
            if not inlier[i]:
                continue
            k = keyframe[i]
            x, y, z = in_camera(R, t, k, position, p)
            ru, rv, rd, error = residuals(x, y, z, calibration, measured, information, i)
            if error == np.inf:
                continue
            scale, limit = weight[i], limit_of(information, i)
            if robust and error > limit:
                scale *= np.sqrt(limit / error)
            a00, a02, a11, a12, a22, b0, b1, b2 = told_of_point(
                x, y, z, ru, rv, rd, scale * information[i, 0], scale * information[i, 1], calibration
            )
            f = free[k]
            if f >= 0:
                used[i] = True
                add_to_pose(H, g, block[f, f], f, x, y, z, a00, 0.0, a02, a11, a12, a22, b0, b1, b2)
            if is_free:
                u, v, w = R[k, 0, 0], R[k, 1, 0], R[k, 2, 0]
                l0, l1, l2 = a00 * u + a02 * w, a11 * v + a12 * w, a02 * u + a12 * v + a22 * w
                g0 += u * b0 + v * b1 + w * b2
                v00 += u * l0 + v * l1 + w * l2
                u, v, w = R[k, 0, 1], R[k, 1, 1], R[k, 2, 1]
                m0, m1, m2 = a00 * u + a02 * w, a11 * v + a12 * w, a02 * u + a12 * v + a22 * w
                g1 += u * b0 + v * b1 + w * b2
                v01 += u * l0 + v * l1 + w * l2
                v11 += u * m0 + v * m1 + w * m2
                u, v, w = R[k, 0, 2], R[k, 1, 2], R[k, 2, 2]
                n0, n1, n2 = a00 * u + a02 * w, a11 * v + a12 * w, a02 * u + a12 * v + a22 * w
                g2 += u * b0 + v * b1 + w * b2
                v02 += u * l0 + v * l1 + w * l2
                v12 += u * m0 + v * m1 + w * m2
                v22 += u * n0 + v * n1 + w * n2
                if f >= 0:
                    W[i, 0, 0], W[i, 0, 1], W[i, 0, 2] = l0, l1, l2
                    W[i, 0, 3], W[i, 0, 4], W[i, 0, 5] = y * l2 - z * l1, z * l0 - x * l2, x * l1 - y * l0
                    W[i, 1, 0], W[i, 1, 1], W[i, 1, 2] = m0, m1, m2
                    W[i, 1, 3], W[i, 1, 4], W[i, 1, 5] = y * m2 - z * m1, z * m0 - x * m2, x * m1 - y * m0
                    W[i, 2, 0], W[i, 2, 1], W[i, 2, 2] = n0, n1, n2
                    W[i, 2, 3], W[i, 2, 4], W[i, 2, 5] = y * n2 - z * n1, z * n0 - x * n2, x * n1 - y * n0
        if is_free:
            point_gradient[p, 0], point_gradient[p, 1], point_gradient[p, 2] = g0, g1, g2
            solvable[p] = _invert_damped(v00, v01, v02, v11, v12, v22, damping, V_inverse, p)
    diagonal = np.zeros(6 * n_free)
    for f in range(n_free):
        for a in range(6):
            diagonal[6 * f + a] = H[block[f, f], a, a]
    _reduce(H, g, free, start, keyframe, block, W, used, V_inverse, point_gradient, solvable)
    return H, g, diagonal, used, V_inverse, point_gradient, solvable


@compiled
def _reduce(H, g, free, start, keyframe, block, W, used, V_inverse, point_gradient, solvable):  # type: ignore[no-untyped-def]
    """Take W' V^-1 W of each two observations of a landmark from the block of their poses, W' V^-1 b from g."""
    for p in range(solvable.shape[0]):
        if not solvable[p]:
            continue
        v00, v01, v02 = V_inverse[p, 0, 0], V_inverse[p, 0, 1], V_inverse[p, 0, 2]
        v11, v12, v22 = V_inverse[p, 1, 1], V_inverse[p, 1, 2], V_inverse[p, 2, 2]
        b0, b1, b2 = point_gradient[p, 0], point_gradient[p, 1], point_gradient[p, 2]
        for i in range(start[p], start[p + 1]):
            if not used[i]:
                continue
            f = free[keyframe[i]]
            for j in range(i, start[p + 1]):
                if not used[j]:
                    continue
                n = block[f, free[keyframe[j]]]
                w00, w01, w02, w03, w04, w05 = W[j, 0, 0], W[j, 0, 1], W[j, 0, 2], W[j, 0, 3], W[j, 0, 4], W[j, 0, 5]
                w10, w11, w12, w13, w14, w15 = W[j, 1, 0], W[j, 1, 1], W[j, 1, 2], W[j, 1, 3], W[j, 1, 4], W[j, 1, 5]
                w20, w21, w22, w23, w24, w25 = W[j, 2, 0], W[j, 2, 1], W[j, 2, 2], W[j, 2, 3], W[j, 2, 4], W[j, 2, 5]
                for a in range(6):
                    w0, w1, w2 = W[i, 0, a], W[i, 1, a], W[i, 2, a]
                    y0, y1, y2 = (
                        w0 * v00 + w1 * v01 + w2 * v02,
                        w0 * v01 + w1 * v11 + w2 * v12,
                        w0 * v02 + w1 * v12 + w2 * v22,
                    )
                    if i == j:
                        g[6 * f + a] -= y0 * b0 + y1 * b1 + y2 * b2
                    H[n, a, 0] -= y0 * w00 + y1 * w10 + y2 * w20
                    H[n, a, 1] -= y0 * w01 + y1 * w11 + y2 * w21
                    H[n, a, 2] -= y0 * w02 + y1 * w12 + y2 * w22
                    H[n, a, 3] -= y0 * w03 + y1 * w13 + y2 * w23
                    H[n, a, 4] -= y0 * w04 + y1 * w14 + y2 * w24
                    H[n, a, 5] -= y0 * w05 + y1 * w15 + y2 * w25


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
                        back[c] -= W[i, c, a] * step[f + a]
        for c in range(3):
            new_position[p, c] += (
                V_inverse[p, c, 0] * back[0] + V_inverse[p, c, 1] * back[1] + V_inverse[p, c, 2] * back[2]
            )
    return new_R, new_t, new_position


@compiled
def _invert_damped(a, b, c, d, e, f, damping, out, p):  # type: ignore[no-untyped-def]
    """Inverse of V[p] (3, 3; upper triangle) with its diagonal raised by `damping`; False when it is singular."""
    a, d, f = a * (1.0 + damping), d * (1.0 + damping), f * (1.0 + damping)
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * A + b * B + c * C
    if not determinant > 1e-12 * a * d * f or determinant <= 0.0:
        return False
    out[p, 0, 0], out[p, 0, 1], out[p, 0, 2] = A / determinant, B / determinant, C / determinant
    out[p, 1, 0], out[p, 1, 1], out[p, 1, 2] = (
        out[p, 0, 1],
        (a * f - c * c) / determinant,
        (b * c - a * e) / determinant,
    )
    out[p, 2, 0], out[p, 2, 1], out[p, 2, 2] = out[p, 0, 2], out[p, 1, 2], (a * d - b * b) / determinant
    return True
