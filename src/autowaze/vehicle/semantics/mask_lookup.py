"""Which instance's mask a feature lies in."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.world.features import CameraFeatures
from autowaze.world.instances import Detections, Tracks

_ERODED_PX = 1  # masks spill over the silhouette by a pixel or two, where corners of the background lie
_MIN_DEPTHS = 3


def instances_at(features: CameraFeatures, instances: Detections | Tracks) -> NDArray[np.int64]:
    """Row (F,) of the instance whose mask, eroded by a pixel, holds each feature; -1 for none.

    Where masks overlap the nearer instance wins, by the median depth of the features in each mask.
    """
    height, width = instances.mask.shape[1:]
    owner = np.full((height, width), -1, np.int16)
    kernel = np.ones((2 * _ERODED_PX + 1, 2 * _ERODED_PX + 1), np.uint8)
    for i in _far_to_near(features, instances):
        x0, y0 = np.maximum(np.floor(instances.box[i, :2]).astype(int), 0)
        x1, y1 = np.ceil(instances.box[i, 2:]).astype(int)
        part = np.ascontiguousarray(instances.mask[i, y0:y1, x0:x1]).view(np.uint8)
        if part.size:
            eroded = cv2.erode(part, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=(0,))
            owner[y0:y1, x0:x1][eroded > 0] = i
    row, column = _pixels(features, height, width)
    return owner[row, column].astype(np.int64)


def _far_to_near(features: CameraFeatures, instances: Detections | Tracks) -> NDArray[np.int64]:
    """Rows of the instances, those without depth first."""
    row, column = _pixels(features, *instances.mask.shape[1:])
    inside = instances.mask[:, row, column] & np.isfinite(features.depth)
    median = np.full(len(instances), np.inf)
    for i in np.flatnonzero(np.count_nonzero(inside, axis=1) >= _MIN_DEPTHS):
        median[i] = np.median(features.depth[inside[i]])
    return np.argsort(-median, kind="stable")


def _pixels(features: CameraFeatures, height: int, width: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column (F,) of the pixels that features lie in."""
    pixel = np.rint(features.uv).astype(np.int64)
    return np.clip(pixel[:, 1], 0, height - 1), np.clip(pixel[:, 0], 0, width - 1)
