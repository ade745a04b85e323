"""Stereo matching of sparse features along rows (ORB-SLAM2, sec. III-B: row band, Hamming, SAD, parabola)."""

from __future__ import annotations

from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.compiled import compiled, hamming
from autowaze.vehicle.vision.orb import Keypoints
from autowaze.vehicle.vision.pyramid import Pyramid

_HALF_WINDOW_PX = 5  # 11 x 11
_HALF_SEARCH_PX = 5
_MAX_COST = 0.5  # SAD over the patch's own contrast: a median SAD would drop the high-contrast patches, the best
_RATIO = 0.85  # of the best Hamming distance to that of the best match elsewhere on the row
_ELSEWHERE_PX = 4.0  # on the level of the feature


def match_stereo(
    left: Keypoints,
    right: Keypoints,
    left_pyramid: Pyramid,
    right_pyramid: Pyramid,
    min_disparity_px: float,
    max_disparity_px: float,
    max_hamming: int,
    helper: Executor,
) -> NDArray[np.float32]:
    """Column in the right image of each left feature, (N,) float32; NaN where none agrees.

    Args:
        left, right: features of the rectified images.
        left_pyramid, right_pyramid: their scale pyramids.
        min_disparity_px, max_disparity_px: range of u_left - u_right.
        max_hamming: most differing bits.
        helper: takes half of the work.
    """
    layout = left_pyramid.layout
    order = np.argsort(right.uv[:, 1], kind="stable")
    rows = np.searchsorted(right.uv[order, 1], np.arange(layout.height[0] + 1)).astype(np.int64)
    candidates = right.uv[order], right.octave[order], right.descriptor[order].view(np.uint64), rows
    images = left_pyramid.block, right_pyramid.block, layout.width, layout.height, layout.offset
    limits = layout.scale, layout.pixel, min_disparity_px, max_disparity_px, max_hamming

    def match(part: slice) -> NDArray[np.float32]:
        words = left.descriptor[part].view(np.uint64)
        return np.asarray(_match_rows(left.uv[part], left.octave[part], words, *candidates, *images, *limits))

    half = len(left) // 2
    second = helper.submit(match, slice(half, None))
    return np.concatenate([match(slice(0, half)), second.result()])


@compiled
def _match_rows(  # type: ignore[no-untyped-def]
    uv_left, octave_left, words_left, uv_right, octave_right, words_right, rows,
    block_left, block_right, width, height, offset, scale, pixel, min_disparity, max_disparity, max_hamming,
):  # fmt: skip
    n = uv_left.shape[0]
    u_right = np.full(n, np.nan, np.float32)
    last_row = rows.shape[0] - 1
    for i in range(n):
        octave = np.int64(octave_left[i])
        band = 2.0 * scale[octave]
        first = max(np.int64(np.ceil(uv_left[i, 1] - band)), 0)
        last = min(np.int64(np.floor(uv_left[i, 1] + band)) + 1, last_row)
        best: Any = -1
        best_distance, second = np.int64(257), np.int64(257)
        for j in range(rows[min(first, last_row)], rows[last]):
            disparity = uv_left[i, 0] - uv_right[j, 0]
            if disparity < min_disparity - 2.0 or disparity > max_disparity:
                continue
            if abs(np.int64(octave_right[j]) - octave) > 1:
                continue
            distance = np.int64(hamming(words_left[i], words_right[j]))
            if distance >= second:
                continue
            elsewhere = best < 0 or abs(uv_right[j, 0] - uv_right[best, 0]) > _ELSEWHERE_PX * scale[octave]
            if distance < best_distance:
                if elsewhere:
                    second = best_distance
                best, best_distance = j, distance
            elif elsewhere:
                second = distance
        if best < 0 or best_distance > max_hamming or best_distance > _RATIO * second:
            continue
        u = _refine(
            block_left[offset[octave] :], block_right[offset[octave] :], width[octave], height[octave],
            (uv_left[i, 0] + 0.5) / pixel[octave, 0] - 0.5, (uv_left[i, 1] + 0.5) / pixel[octave, 1] - 0.5,
            (uv_right[best, 0] + 0.5) / pixel[octave, 0] - 0.5,
        )  # fmt: skip
        disparity = uv_left[i, 0] - ((u + 0.5) * pixel[octave, 0] - 0.5)
        if min_disparity <= disparity <= max_disparity:
            u_right[i] = uv_left[i, 0] - disparity
    return u_right


@compiled
def _refine(left, right, width, height, u_left, v, u_right):  # type: ignore[no-untyped-def]
    """Column of the least SAD near `u_right` to a fraction of a pixel; NaN where the patches do not agree."""
    w, s = _HALF_WINDOW_PX, _HALF_SEARCH_PX
    ul, ur, row = np.int64(np.rint(u_left)), np.int64(np.rint(u_right)), np.int64(np.rint(v))
    if row - w < 0 or row + w >= height or ul - w < 0 or ul + w >= width or ur - w - s < 0 or ur + w + s >= width:
        return np.nan
    sad = np.zeros(2 * s + 1, np.int64)
    contrast = np.int64(0)
    centre_left = np.int64(left[row * width + ul])
    for y in range(row - w, row + w + 1):
        for x in range(ul - w, ul + w + 1):
            contrast += abs(np.int64(left[y * width + x]) - centre_left)
    best: Any = 0
    for d in range(2 * s + 1):
        centre_right = np.int64(right[row * width + ur + d - s])
        total = np.int64(0)
        for y in range(row - w, row + w + 1):
            a, b = y * width + ul - w, y * width + ur + d - s - w
            for x in range(2 * w + 1):
                total += abs((np.int64(left[a + x]) - centre_left) - (np.int64(right[b + x]) - centre_right))
        sad[d] = total
        if total < sad[best]:
            best = d
    if best == 0 or best == 2 * s or sad[best] > _MAX_COST * contrast:
        return np.nan
    before, least, after = sad[best - 1], sad[best], sad[best + 1]
    curvature = before - 2 * least + after
    delta = 0.5 * (before - after) / curvature if curvature > 0 else 0.0
    return u_left + (ur + best - s - ul) + delta
