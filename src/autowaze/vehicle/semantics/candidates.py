"""What a network proposes, before overlapping proposals of one thing are reduced to the best."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.classes import UNKNOWN_CLASS, kinds
from autowaze.world.columns import Columns

_NMS_IOU = 0.6
_MAX_INSTANCES = 100


@dataclass
class Candidates(Columns):
    """N proposals of one image.

    Attributes:
        box: (N, 4) float32, left, top, right, bottom in pixels.
        label: (N,) uint8, a `ClassLabel` or `UNKNOWN_CLASS`.
        confidence: (N,) float32.
        row: (N,) int64, the network's own number of the proposal, to find its mask by.
    """

    box: NDArray[np.float32]
    label: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    row: NDArray[np.int64]

    def confident(self, min_confidence: float) -> Candidates:
        """Those of a class that means something, with enough confidence and a box with an area."""
        has_area = (self.box[:, 2:] > self.box[:, :2]).all(axis=1)
        return self[(self.label != UNKNOWN_CLASS) & (self.confidence >= min_confidence) & has_area]

    def best(self) -> Candidates:
        """Survivors of non-maximum suppression, the most confident first.

        All vehicles compete with each other, as networks like to call one van both car and truck.
        """
        if not len(self):
            return self
        corner_and_size = np.concatenate([self.box[:, :2], self.box[:, 2:] - self.box[:, :2]], axis=1)
        kept = cv2.dnn.NMSBoxesBatched(
            corner_and_size.tolist(), self.confidence.tolist(), kinds(self.label).tolist(), 0.0, _NMS_IOU
        )
        survivors = self[np.sort(np.asarray(kept, np.int64).ravel())]
        return survivors[np.argsort(-survivors.confidence, kind="stable")[:_MAX_INSTANCES]]


def label_of(table: NDArray[np.uint8], classes: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Labels (N,) of a model's class numbers (N,); those beyond the table mean nothing."""
    known = (classes >= 0) & (classes < len(table))
    return np.where(known, table[np.where(known, classes, 0)], np.uint8(UNKNOWN_CLASS)).astype(np.uint8)
