"""Who continues what: overlaps of boxes, and the Hungarian method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment


def overlaps(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """IoU (A, B), and the share (A, B) of each box of `a` that lies in each of `b`."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=2)
    area_a = np.maximum((a[:, 2:] - a[:, :2]).prod(axis=1), 1e-9)[:, None]
    area_b = np.maximum((b[:, 2:] - b[:, :2]).prod(axis=1), 1e-9)[None, :]
    return shared / (area_a + area_b - shared), shared / area_a


def assign(rows: NDArray[np.int64], score: NDArray[np.float64]) -> None:
    """Give detections without a track the one that maximises the total score (D, T); zero means impossible."""
    free_detections = np.flatnonzero(rows < 0)
    is_free = np.ones(score.shape[1], np.bool_)
    is_free[rows[rows >= 0]] = False
    free_tracks = np.flatnonzero(is_free)
    if not len(free_detections) or not len(free_tracks):
        return
    open_score = score[np.ix_(free_detections, free_tracks)]
    d, t = linear_sum_assignment(open_score, maximize=True)
    possible = open_score[d, t] > 0
    rows[free_detections[d[possible]]] = free_tracks[t[possible]]
