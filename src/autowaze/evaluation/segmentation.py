"""Instance segmentation against truth: precision, recall and AP50 by size, and touching pairs kept apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from autowaze.world.columns import Columns
from autowaze.world.instances import Detections

MIN_IOU = 0.5
"""Mask overlap from which a detection counts as the true instance."""


@dataclass
class MaskMatches(Columns):
    """Detections of one or many frames, N rows in order of frames.

    Attributes:
        confidence: (N,) float32.
        area: (N,) int64, pixels of the true mask where one was found, else of the detected one.
        correct: (N,) bool, whether a true instance was found.
    """

    confidence: NDArray[np.float32]
    area: NDArray[np.int64]
    correct: NDArray[np.bool_]


@dataclass(frozen=True)
class FrameScore:
    """One frame's detections against its truth.

    Attributes:
        matches: the detections.
        true_area: (T,) int64, pixels of the true instances.
        found: (T,) bool, which of them were found.
        touching_pairs, separated_pairs: true instances that touch in the image, and those of them that were found as
            two.
    """

    matches: MaskMatches
    true_area: NDArray[np.int64]
    found: NDArray[np.bool_]
    touching_pairs: int
    separated_pairs: int


def score_frame(detections: Detections, true_masks: NDArray[np.bool_]) -> FrameScore:
    """Match detections with true masks (T, H, W), one to one, so that the total overlap is greatest."""
    iou, area, true_area = _mask_ious(detections.mask, true_masks)
    d, t = linear_sum_assignment(np.where(iou >= MIN_IOU, iou, 0.0), maximize=True)
    good = iou[d, t] >= MIN_IOU
    correct = np.zeros(len(detections), np.bool_)
    correct[d[good]] = True
    found = np.zeros(len(true_masks), np.bool_)
    found[t[good]] = True
    area[d[good]] = true_area[t[good]]
    pairs = _touching(true_masks)
    separated = found[pairs[:, 0]] & found[pairs[:, 1]]
    return FrameScore(
        MaskMatches(detections.confidence, area, correct), true_area, found, len(pairs), int(separated.sum())
    )


def summarise(frames: list[FrameScore], min_area: int = 0) -> dict[str, float]:
    """Precision, recall and AP50 over true instances and detections of at least `min_area` pixels.

    A detection that matches a smaller true instance counts neither way, as in COCO's scores by size.
    """
    matches = MaskMatches.concatenate([f.matches for f in frames])
    matches = matches[matches.area >= min_area]
    n_true = sum(int((f.true_area >= min_area).sum()) for f in frames)
    n_found = sum(int((f.found & (f.true_area >= min_area)).sum()) for f in frames)
    pairs = sum(f.touching_pairs for f in frames)
    separated = sum(f.separated_pairs for f in frames)
    return {
        "instances": float(n_true),
        "precision": float(matches.correct.mean()) if len(matches) else 1.0,
        "recall": n_found / n_true if n_true else 1.0,
        "ap50": average_precision(matches, n_true),
        "touching_pairs": float(pairs),
        "touching_separated": separated / pairs if pairs else 1.0,
    }


def average_precision(matches: MaskMatches, n_true: int) -> float:
    """Area under the precision-recall curve at 101 recall levels (Lin et al. 2014, COCO)."""
    if n_true == 0:
        return 1.0
    order = np.argsort(-matches.confidence, kind="stable")
    hits = np.cumsum(matches.correct[order])
    precision = hits / np.arange(1, len(order) + 1)
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    at = np.searchsorted(hits / n_true, np.linspace(0, 1, 101), side="left")
    return float(np.append(precision, 0.0)[at].mean())


def _mask_ious(
    masks: NDArray[np.bool_], true_masks: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """IoU (D, T) and areas (D,), (T,) in pixels."""
    a, b = (m.reshape(len(m), m.shape[1] * m.shape[2]).astype(np.float32) for m in (masks, true_masks))
    area, true_area = a.sum(axis=1), b.sum(axis=1)
    shared = a @ b.T
    union = np.maximum(area[:, None] + true_area[None, :] - shared, 1.0)
    return (shared / union).astype(np.float64), area.astype(np.int64), true_area.astype(np.int64)


def _touching(masks: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Pairs (P, 2) of masks (T, H, W) with pixels side by side."""
    owner = np.full(masks.shape[1:], -1, np.int64)
    for i, mask in enumerate(masks):
        owner[mask] = i
    sides = [np.stack([owner[:, :-1].ravel(), owner[:, 1:].ravel()]), np.stack([owner[:-1].ravel(), owner[1:].ravel()])]
    pairs = np.concatenate(sides, axis=1)
    pairs = pairs[:, (pairs >= 0).all(axis=0) & (pairs[0] != pairs[1])]
    return np.unique(np.sort(pairs, axis=0), axis=1).T.reshape(-1, 2)
