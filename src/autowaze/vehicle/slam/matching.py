"""Landmarks to features: the least Hamming distance within a window around the predicted pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.observed_frame import CELL_PX, ObservedFrame
from autowaze.vehicle.vision.compiled import compiled, hamming


def match_in_windows(
    frame: ObservedFrame,
    words: NDArray[np.uint64],
    row: NDArray[np.int64],
    pixel: NDArray[np.float64],
    level: NDArray[np.int64],
    radius_px: NDArray[np.float64],
    taken: NDArray[np.bool_],
    max_hamming: int,
    ratio: float,
) -> NDArray[np.int64]:
    """Feature row of each prediction (M,); -1 for none. A feature goes to the prediction that is most like it.

    Args:
        frame: the features (N).
        words: (L, 4) uint64, descriptors. row: (M,) those of what is sought.
        pixel: (M, 3), where: u, v and disparity.
        level: (M,) predicted pyramid level; features one level finer or coarser pass.
        radius_px: (M,) half the window.
        taken: (N,) features that are spoken for.
        max_hamming: most differing bits. ratio: best over second best of the same level must be below.
    """
    return np.asarray(
        _match(
            words,
            row,
            pixel,
            level,
            radius_px,
            frame.words,
            frame.cell_measured,
            frame.cell_octave,
            frame.cell_start,
            frame.in_cell,
            frame.n_columns,
            frame.n_rows,
            taken,
            max_hamming,
            ratio,
        )
    )


@compiled
def _match(  # type: ignore[no-untyped-def]  # noqa: PLR0912
    words, row, pixel, level, radius, feature_words, measured, octave, cell_start, in_cell, n_columns, n_rows, taken,
    max_hamming, ratio,
):  # fmt: skip
    n, m = feature_words.shape[0], row.shape[0]
    owner = np.full(n, -1, np.int64)
    owner_distance = np.full(n, 1 << 20, np.int64)
    for i in range(m):
        u, v, disparity, r = pixel[i, 0], pixel[i, 1], pixel[i, 2], radius[i]
        c0 = max(np.int64((u - r) / CELL_PX), 0)
        c1 = min(np.int64((u + r) / CELL_PX), n_columns - 1)
        r0: Any = max(np.int64((v - r) / CELL_PX), 0)
        r1 = min(np.int64((v + r) / CELL_PX), n_rows - 1)
        if u + r < 0.0 or v + r < 0.0 or c0 > c1 or r0 > r1:
            continue
        best, best_distance, best_level = np.int64(-1), np.int64(1 << 20), np.int64(-1)
        second, second_level = best_distance, best_level
        for line in range(r0, r1 + 1):
            for k in range(cell_start[line * n_columns + c0], cell_start[line * n_columns + c1 + 1]):
                if abs(measured[k, 0] - u) > r or abs(measured[k, 1] - v) > r or abs(octave[k] - level[i]) > 1:
                    continue
                if abs(measured[k, 2] - disparity) > r:  # false for NaN: features without depth pass
                    continue
                j = in_cell[k]
                if taken[j]:
                    continue
                distance = np.int64(hamming(words, row[i], feature_words, j))
                if distance < best_distance:
                    second, second_level = best_distance, best_level
                    best, best_distance, best_level = j, distance, octave[k]
                elif distance < second:
                    second, second_level = distance, octave[k]
        if best < 0 or best_distance > max_hamming:
            continue
        if best_level == second_level and best_distance > ratio * second:
            continue
        if best_distance < owner_distance[best]:
            owner[best], owner_distance[best] = i, best_distance
    found = np.full(m, -1, np.int64)
    for j in range(n):
        if owner[j] >= 0:
            found[owner[j]] = j
    return found
