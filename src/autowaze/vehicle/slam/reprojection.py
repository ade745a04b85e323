"""One landmark in one stereo camera: its error, and what that tells of the point and of the pose.

Everything passes as numbers, which a compiler keeps in registers: slices of arrays would be counted references, and
arrays that may overlap would be read again after each write. With J the derivative of (u, v, disparity) by the point in
the camera and Lambda its information, A = J' Lambda J is what the observation tells of the point. A small motion
(translation, rotation) of the camera moves a point p by [I, -[p]x], so the pose gets A, [p]x A and [p]x A [p]x'.
"""

from __future__ import annotations

import numpy as np

from autowaze.vehicle.vision.compiled import compiled

CHI2_MONO = 5.991  # 95 % of chi squared with 2 degrees of freedom
CHI2_STEREO = 7.815  # and with 3
_NEAREST_M = 0.05  # what lies nearer, or behind, is an error without measure


@compiled
def in_camera(R, t, k, position, p):  # type: ignore[no-untyped-def]
    """Landmark p of positions (P, 3) in camera k of R (K, 3, 3), t (K, 3): x, y, z."""
    u, v, w = position[p, 0], position[p, 1], position[p, 2]
    x = R[k, 0, 0] * u + R[k, 0, 1] * v + R[k, 0, 2] * w + t[k, 0]
    y = R[k, 1, 0] * u + R[k, 1, 1] * v + R[k, 1, 2] * w + t[k, 1]
    z = R[k, 2, 0] * u + R[k, 2, 1] * v + R[k, 2, 2] * w + t[k, 2]
    return x, y, z


@compiled
def residuals(x, y, z, calibration, measured, information, i):  # type: ignore[no-untyped-def]
    """Errors in u, v and disparity of observation i, and their squared sum over the variances."""
    if z < _NEAREST_M:
        return 0.0, 0.0, 0.0, np.inf
    inverse = 1.0 / z
    ru = calibration[0] * x * inverse + calibration[2] - measured[i, 0]
    rv = calibration[1] * y * inverse + calibration[3] - measured[i, 1]
    rd = 0.0
    if information[i, 1] > 0.0:
        rd = calibration[4] * inverse - measured[i, 2]
    return ru, rv, rd, information[i, 0] * (ru * ru + rv * rv) + information[i, 1] * rd * rd


@compiled
def limit_of(information, i):  # type: ignore[no-untyped-def]
    """Squared error beyond which an observation is an outlier."""
    return CHI2_STEREO if information[i, 1] > 0.0 else CHI2_MONO


@compiled
def told_of_point(x, y, z, ru, rv, rd, wu, wd, calibration):  # type: ignore[no-untyped-def]
    """A = J' Lambda J as (xx, xz, yy, yz, zz), whose xy is 0, and J' Lambda r (3).

    wu and wd are the inverse variances of u and v, and of the disparity.
    """
    inverse = 1.0 / z
    a, c, e = calibration[0] * inverse, calibration[1] * inverse, -calibration[4] * inverse * inverse
    b, d = -a * x * inverse, -c * y * inverse
    wa, wb, wc, wd_, we = wu * a, wu * b, wu * c, wu * d, wd * e
    zz = wb * b + wd_ * d + we * e
    return wa * a, wa * b, wc * c, wc * d, zz, wa * ru, wc * rv, wb * ru + wd_ * rv + we * rd


@compiled
def add_to_pose(H, g, k, f, x, y, z, a00, a01, a02, a11, a12, a22, b0, b1, b2):  # type: ignore[no-untyped-def]
    """Add what an observation tells of its camera: to the upper triangle of H[k] (6, 6), and to g from 6 k on."""
    # G = [p]x A, row by row
    g00, g01, g02 = y * a02 - z * a01, y * a12 - z * a11, y * a22 - z * a12
    g10, g11, g12 = z * a00 - x * a02, z * a01 - x * a12, z * a02 - x * a22
    g20, g21, g22 = x * a01 - y * a00, x * a11 - y * a01, x * a12 - y * a02
    H[k, 0, 0] += a00
    H[k, 0, 1] += a01
    H[k, 0, 2] += a02
    H[k, 0, 3] += g00
    H[k, 0, 4] += g10
    H[k, 0, 5] += g20
    H[k, 1, 1] += a11
    H[k, 1, 2] += a12
    H[k, 1, 3] += g01
    H[k, 1, 4] += g11
    H[k, 1, 5] += g21
    H[k, 2, 2] += a22
    H[k, 2, 3] += g02
    H[k, 2, 4] += g12
    H[k, 2, 5] += g22
    H[k, 3, 3] += y * g02 - z * g01
    H[k, 3, 4] += z * g00 - x * g02
    H[k, 3, 5] += x * g01 - y * g00
    H[k, 4, 4] += z * g10 - x * g12
    H[k, 4, 5] += x * g11 - y * g10
    H[k, 5, 5] += x * g21 - y * g20
    g[6 * f] += b0
    g[6 * f + 1] += b1
    g[6 * f + 2] += b2
    g[6 * f + 3] += y * b2 - z * b1
    g[6 * f + 4] += z * b0 - x * b2
    g[6 * f + 5] += x * b1 - y * b0
