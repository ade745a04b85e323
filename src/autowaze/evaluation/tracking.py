"""Tracking against truth: IDF1 (Ristani et al. 2016), identity switches and MOTA (Bernardin & Stiefelhagen 2008)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import DependencyError

MIN_IOU = 0.5
"""Box overlap from which a track counts as following a true object."""

_METRICS = {
    "idf1": "idf1",
    "num_switches": "id_switches",
    "mota": "mota",
    "num_fragmentations": "fragmentations",
    "num_unique_objects": "objects",
    "recall": "recall",
    "precision": "precision",
}


class TrackingScore:
    """Frames come in, scores come out; by py-motmetrics."""

    def __init__(self) -> None:
        try:
            import motmetrics
        except ImportError as error:
            raise DependencyError("scoring tracks needs motmetrics: pip install 'autowaze[evaluate]'") from error
        self._motmetrics = motmetrics
        self._frames: Any = motmetrics.MOTAccumulator(auto_id=True)

    def add(
        self,
        true_id: NDArray[np.integer],
        true_box: NDArray[np.floating],
        track_id: NDArray[np.integer],
        track_box: NDArray[np.floating],
    ) -> None:
        """Take in one frame: ids (T,), (N,) and boxes (T, 4), (N, 4) as left, top, right, bottom."""
        overlap = box_iou(true_box, track_box)
        distance = np.where(overlap >= MIN_IOU, 1.0 - overlap, np.nan)
        self._frames.update(true_id.tolist(), track_id.tolist(), distance)

    def metrics(self) -> dict[str, float]:
        """Scores over all frames, by flat names."""
        table = self._motmetrics.metrics.create().compute(self._frames, metrics=list(_METRICS), name="all")
        scores = {ours: float(table.loc["all", theirs]) for theirs, ours in _METRICS.items()}
        scores["id_switches_per_object"] = scores["id_switches"] / max(scores["objects"], 1.0)
        return scores


def box_iou(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.float64]:
    """IoU (A, B) of boxes (A, 4) and (B, 4)."""
    a, b = np.asarray(a, np.float64).reshape(-1, 4), np.asarray(b, np.float64).reshape(-1, 4)
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=2)
    area_a, area_b = ((box[:, 2:] - box[:, :2]).prod(axis=1) for box in (a, b))
    return np.asarray(shared / np.maximum(area_a[:, None] + area_b[None, :] - shared, 1e-9))
