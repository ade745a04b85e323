"""Disparity of sparse features: an exhaustive search along the row by sums of absolute differences.

The right image needs no features of its own. Sums over all columns of a row are what vector units do best; they find a
partner for nine of ten features, where matching against detected corners finds six or seven. Two lines of equal slope
through the least sum and its neighbours give the fraction of a pixel; a parabola would lean to whole pixels
(Shimizu & Okutomi 2005, "Sub-pixel estimation error cancellation on area-based matching").

All that takes a patch for a piece of a wall that faces the camera. On the road the disparity changes from row to row,
by the baseline over the camera's height, 0.3 pixels; and what is nearest, which tells how far the car has come, is
mostly road. There the disparity and its change per row are found together, by Gauss-Newton on the squared differences
(Lucas & Kanade 1981).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.compiled import compiled
from autowaze.vehicle.vision.corners import Corners
from autowaze.vehicle.vision.pyramid import BLOCK_MARGIN, Pyramid

HALF_WINDOW_PX = 5  # 11 x 11, on the level of the feature
_RATIO = 0.9  # of the least sum to the least one elsewhere on the row
_ELSEWHERE_PX = 3
_MAX_COST = 0.5  # of the least sum to the patch's own contrast: an absolute limit would drop high contrast, the best
NEAR_BASELINES = 25.0  # what lies farther tells directions, not distances
_LEAST_SLANT = 0.1  # change of the disparity per row: below it a patch is as good as upright
_SLANT_ROUNDS, _MOST_CHANGE_PX = 2, 1.5
_REGISTER = 32  # sums of 16 bits in the widest vector register


def match_stereo(
    corners: Corners,
    left: Pyramid,
    right: Pyramid,
    min_disparity_px: float,
    max_disparity_px: float,
    near_px: float = np.inf,
) -> NDArray[np.float32]:
    """Disparity u_left - u_right of each corner in pixels of the image, (N,) float32; NaN where none is certain.

    Args:
        corners: of the left image.
        left, right: scale pyramids of the rectified images.
        min_disparity_px, max_disparity_px: range that counts.
        near_px: from this disparity on surfaces may be slanted.
    """
    layout = left.layout
    disparity = _match(
        corners.xy, corners.octave, left.block, right.block, layout.width, layout.offset,
        max_disparity_px / layout.pixel[:, 0],
    )  # fmt: skip
    _follow_slant(
        corners.xy, corners.octave, left.block, right.block, layout.width, layout.offset,
        near_px / layout.pixel[:, 0], disparity,
    )  # fmt: skip
    disparity *= layout.pixel[corners.octave, 0]
    disparity[~((disparity >= min_disparity_px) & (disparity <= max_disparity_px))] = np.nan
    return np.asarray(disparity, dtype=np.float32)


@compiled
def _match(xy, octave, left, right, width, offset, max_disparity):  # type: ignore[no-untyped-def]
    """Disparities (N,) in level pixels, float64."""
    n = xy.shape[0]
    disparity = np.full(n, np.nan)
    cost = np.zeros(width[0] + BLOCK_MARGIN, np.uint16)
    for i in range(n):
        w = width[octave[i]]
        x, row = xy[i, 0], offset[octave[i]] + xy[i, 1] * w
        first = max(x - np.int64(max_disparity[octave[i]]) - 1, HALF_WINDOW_PX)
        n_columns = min(x + _ELSEWHERE_PX, w - 1 - HALF_WINDOW_PX) - first + 1
        if n_columns < 3:
            continue
        _sum_differences(left, row + x, right, row + first, w, n_columns, cost)
        best = _unambiguous(cost, n_columns)
        if best >= 0 and cost[best] <= _MAX_COST * _contrast(left, row + x, w):
            before, least, after = np.float64(cost[best - 1]), np.float64(cost[best]), np.float64(cost[best + 1])
            slope = max(before, after) - least
            fraction = 0.5 * (before - after) / slope if slope > 0.0 else 0.0
            disparity[i] = x - (first + best + fraction)
    return disparity


@compiled
def _follow_slant(xy, octave, left, right, width, offset, least, disparity):  # type: ignore[no-untyped-def]
    """Mend, in place, disparities (N,) in level pixels, from the least one (L,) on, of patches that are slanted."""
    for i in range(xy.shape[0]):
        if not disparity[i] >= least[octave[i]]:  # nor where it is not known
            continue
        w = width[octave[i]]
        x, row = xy[i, 0], offset[octave[i]] + xy[i, 1] * w
        d, slant = disparity[i], 0.0
        for _ in range(_SLANT_ROUNDS):
            gradient_d, gradient_s, dd, ds, ss = 0.0, 0.0, 0.0, 0.0, 0.0
            is_inside: Any = True
            for dy in range(-HALF_WINDOW_PX, HALF_WINDOW_PX + 1):
                place = np.int64(np.floor(256.0 * (x - d - slant * dy) + 0.5))
                column = place >> 8
                is_inside = is_inside and column >= HALF_WINDOW_PX and column + HALF_WINDOW_PX + 1 < w
                if is_inside:
                    start = row + dy * w - HALF_WINDOW_PX
                    told, weight = _row_told(left, start + x, right, start + column, np.int32(place & 255))
                    gradient_d += told
                    gradient_s += told * dy
                    dd += weight
                    ds += weight * dy
                    ss += weight * dy * dy
            determinant = dd * ss - ds * ds
            if not is_inside or not determinant > 1e-6 * dd * ss:
                slant = 0.0
                break
            d += (ss * gradient_d - ds * gradient_s) / determinant
            slant += (dd * gradient_s - ds * gradient_d) / determinant
        if abs(slant) > _LEAST_SLANT and abs(d - disparity[i]) < _MOST_CHANGE_PX:
            disparity[i] = d


@compiled
def _row_told(left, a, right, b, fraction):  # type: ignore[no-untyped-def]
    """Products of the gradient from `a` on with the differences to what lies `fraction` / 256 behind `b`, and squares.

    Summed as integers, which vector registers do exactly and in any order.
    """
    told, weight, rest = np.int32(0), np.int32(0), np.int32(256 - fraction)
    before, there = np.uint64(a - 1), np.uint64(b)  # unsigned indices need no test for the end
    for i in range(2 * HALF_WINDOW_PX + 1):
        k = np.uint64(i)
        here = np.int32(np.int32(left[before + k + np.uint64(1)]) << np.int32(8))
        gradient = np.int32(np.int32(left[before + k + np.uint64(2)]) - np.int32(left[before + k]))
        other = np.int32(rest * np.int32(right[there + k]) + fraction * np.int32(right[there + k + np.uint64(1)]))
        told = np.int32(told + np.int32(gradient * np.int32(other - here)))
        weight = np.int32(weight + np.int32(gradient * gradient))
    return told / 128.0, np.float64(weight)


@compiled
def _contrast(image, at, width):  # type: ignore[no-untyped-def]
    """Sum of absolute differences of the patch to its middle."""
    middle = np.int32(image[at])
    total = np.int32(0)
    for dy in range(-HALF_WINDOW_PX, HALF_WINDOW_PX + 1):
        start = at + dy * width - HALF_WINDOW_PX
        for value in image[start : start + 2 * HALF_WINDOW_PX + 1]:
            total = np.int32(total + abs(np.int32(value) - middle))
    return total


@compiled
def _sum_differences(left, at, right, first, width, n_columns, cost):  # type: ignore[no-untyped-def]
    """Sums of absolute differences of the patch around `at` to those around `first` and the pixels after it.

    The count is rounded up to whole vector registers; what is computed too much is not looked at.
    """
    n = (n_columns + _REGISTER - 1) // _REGISTER * _REGISTER
    total = cost[:n]
    total[:] = 0
    for dy in range(-HALF_WINDOW_PX, HALF_WINDOW_PX + 1):
        for dx in range(-HALF_WINDOW_PX, HALF_WINDOW_PX + 1):
            step = dy * width + dx
            value = np.int16(left[at + step])
            others = right[first + step : first + step + n]
            for k in range(n):
                total[k] = np.uint16(total[k] + np.uint16(abs(np.int16(value - np.int16(others[k])))))


@compiled
def _unambiguous(cost, n_columns):  # type: ignore[no-untyped-def]
    """Place of the least cost, -1 where it is at an end or not clearly less than everywhere else."""
    least = np.int32(1 << 16)
    for k in range(n_columns):
        least = min(least, np.int32(cost[k]))
    best: Any = 0
    while cost[best] != least:
        best += 1
    if best in (0, n_columns - 1):
        return -1
    limit = np.int32(least / _RATIO)
    alike = np.int32(0)
    for k in range(n_columns):
        alike = np.int32(alike + np.int32(np.int32(cost[k]) <= limit))
    for k in range(max(best - _ELSEWHERE_PX, 0), min(best + _ELSEWHERE_PX + 1, n_columns)):
        alike = np.int32(alike - np.int32(np.int32(cost[k]) <= limit))
    return best if alike == 0 else -1
