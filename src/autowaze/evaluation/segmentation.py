"""Instance segmentation against truth: precision, recall and AP50 by size, and touching pairs kept apart."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.columns import Columns
from autowaze.world.errors import AutowazeError
from autowaze.world.frame import Image
from autowaze.world.instances import Detections
from autowaze.world.labels import is_vehicle

MIN_IOU = 0.5
"""Mask overlap from which a detection counts as the true instance."""

MIN_AREA = 1200
"""Pixels of a 1242 x 375 image from which a vehicle is asked for."""

SIZES = {"small": (0.0, 32.0**2), "medium": (32.0**2, 96.0**2), "large": (96.0**2, np.inf)}
"""COCO's (Lin et al. 2014), in pixels of the true mask."""

_WARM_UP = 3


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
        shown_by: (T,) int64, row of the detection that shows most of each true instance, -1 for none.
        touching: (P, 2) int64, rows of true instances that touch in the image.
    """

    matches: MaskMatches
    true_area: NDArray[np.int64]
    found: NDArray[np.bool_]
    shown_by: NDArray[np.int64]
    touching: NDArray[np.int64]


def score_frame(detections: Detections, true_masks: NDArray[np.bool_]) -> FrameScore:
    """Match detections with true masks (T, H, W), one to one, so that the total overlap is greatest."""
    iou, shared, area, true_area = _mask_overlaps(detections.mask, true_masks)
    d, t = linear_sum_assignment(np.where(iou >= MIN_IOU, iou, 0.0), maximize=True)
    good = iou[d, t] >= MIN_IOU
    correct = np.zeros(len(detections), np.bool_)
    correct[d[good]] = True
    found = np.zeros(len(true_masks), np.bool_)
    found[t[good]] = True
    area[d[good]] = true_area[t[good]]
    shown_by = np.full(len(true_masks), -1)
    if len(detections):
        shown_by = np.where(shared.any(axis=0), shared.argmax(axis=0), -1)
    matches = MaskMatches(detections.confidence, area, correct)
    return FrameScore(matches, true_area, found, shown_by, _touching(true_masks))


def summarise(frames: list[FrameScore], min_area: float = 0, max_area: float = np.inf) -> dict[str, float]:
    """Precision, recall and AP50 over true instances and detections of `min_area` to `max_area` pixels.

    A detection that matches a true instance of another size counts neither way, as in COCO's scores by size. Of the
    pairs that touch, those count whose instances both are of that size: they are separated when each is shown, for the
    most part, by a detection of its own, and found when both match theirs.
    """
    matches = MaskMatches.concatenate([f.matches for f in frames])
    matches = matches[(matches.area >= min_area) & (matches.area < max_area)]
    n_true = n_found = pairs = separated = pairs_found = 0
    for f in frames:
        counts = (f.true_area >= min_area) & (f.true_area < max_area)
        both = counts[f.touching].all(axis=1)
        n_true += int(counts.sum())
        n_found += int((f.found & counts).sum())
        pairs += int(both.sum())
        pairs_found += int(f.found[f.touching[both]].all(axis=1).sum())
        one, other = f.shown_by[f.touching[both]].T
        separated += int(((one >= 0) & (other >= 0) & (one != other)).sum())
    return {
        "instances": float(n_true),
        "precision": float(matches.correct.mean()) if len(matches) else 1.0,
        "recall": n_found / n_true if n_true else 1.0,
        "ap50": average_precision(matches, n_true),
        "touching_pairs": float(pairs),
        "touching_separated": separated / pairs if pairs else 1.0,
        "touching_found": pairs_found / pairs if pairs else 1.0,
    }


def sized_summary(frames: list[FrameScore], min_area: int = MIN_AREA) -> dict[str, float]:
    """`summarise` from `min_area` pixels on, and precision, recall and AP50 by the sizes that COCO tells apart."""
    scores = summarise(frames, min_area)
    for size, (low, high) in SIZES.items():
        by_size = summarise(frames, low, high)
        scores.update({f"{name}_{size}": by_size[name] for name in ("instances", "precision", "recall", "ap50")})
    return scores


def disjoint_masks(detections: Detections) -> NDArray[np.bool_]:
    """Masks (N, H, W) of a reference model's detections for use as truth: each pixel is of the most confident one.

    Masks of which nothing is left are dropped.
    """
    order = np.argsort(-detections.confidence, kind="stable")
    masks = detections.mask[order]
    taken = np.zeros(masks.shape[1:], np.bool_)
    out = np.zeros_like(masks)
    for mine, mask in zip(out, masks, strict=True):
        mine[:] = mask & ~taken
        taken |= mask
    return out[out.any(axis=(1, 2))]


@dataclass
class SegmenterRun:
    """A model's scores over frames, and how long each took it.

    Attributes:
        frames: one score per frame.
        milliseconds: of each frame by the clock, network and decoding.
    """

    frames: list[FrameScore] = field(default_factory=list)
    milliseconds: list[float] = field(default_factory=list)

    def metrics(self, min_area: int = MIN_AREA) -> dict[str, float]:
        """`sized_summary` with the times; the first frames, in which networks settle, are not timed."""
        timed = self.milliseconds[_WARM_UP:] or self.milliseconds
        times = {"segment_ms_median": float(np.median(timed)), "segment_ms_p95": float(np.percentile(timed, 95))}
        return {"frames": float(len(self.frames)), **sized_summary(self.frames, min_area), **times}


def run_segmenter(model: Segmenter, frames: Iterable[tuple[Image, NDArray[np.bool_]]]) -> SegmenterRun:
    """Segment images and score the vehicles found against the masks (T, H, W) of the true ones.

    Raises:
        AutowazeError: no frames.
    """
    run = SegmenterRun()
    for image, masks in frames:
        start = time.perf_counter()
        found = model.segment(image)
        run.milliseconds.append(1000 * (time.perf_counter() - start))
        run.frames.append(score_frame(found[is_vehicle(found.label)], masks))
    if not run.frames:
        raise AutowazeError("no frames to segment")
    return run


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


def _mask_overlaps(
    masks: NDArray[np.bool_], true_masks: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]]:
    """IoU (D, T), pixels in common (D, T), and areas (D,), (T,) in pixels."""
    a, b = (m.reshape(len(m), m.shape[1] * m.shape[2]).astype(np.float32) for m in (masks, true_masks))
    area, true_area = a.sum(axis=1), b.sum(axis=1)
    shared = a @ b.T
    union = np.maximum(area[:, None] + true_area[None, :] - shared, 1.0)
    return (shared / union).astype(np.float64), shared, area.astype(np.int64), true_area.astype(np.int64)


def _touching(masks: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Pairs (P, 2) of masks (T, H, W) with pixels side by side."""
    owner = np.full(masks.shape[1:], -1, np.int64)
    for i, mask in enumerate(masks):
        owner[mask] = i
    sides = [np.stack([owner[:, :-1].ravel(), owner[:, 1:].ravel()]), np.stack([owner[:-1].ravel(), owner[1:].ravel()])]
    pairs = np.concatenate(sides, axis=1)
    pairs = pairs[:, (pairs >= 0).all(axis=0) & (pairs[0] != pairs[1])]
    return np.unique(np.sort(pairs, axis=0), axis=1).T.reshape(-1, 2)
