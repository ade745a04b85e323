"""Which instance's mask a feature lies in."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.stereo import HALF_WINDOW_PX
from autowaze.world.features import CameraFeatures
from autowaze.world.instances import Detections, Tracks

_ERODED_PX = 1  # masks spill over the silhouette by a pixel or two, where corners of the background lie
_MIN_DEPTHS = 3
_SAME_GROUND_PX, _FAR_PERCENTILE = 1.0, 95
_AROUND = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y], np.float64)


def instances_at(features: CameraFeatures, instances: Detections | Tracks) -> NDArray[np.int64]:
    """Row (F,) of the instance whose mask, eroded by a pixel, holds each feature; -1 for none.

    Where masks overlap the nearer instance wins, by the median depth of the features in each mask.
    """
    return _owners_at(_owners(features, instances), features.uv)


def own_surfaces_at(features: CameraFeatures, instances: Detections | Tracks) -> NDArray[np.int64]:
    """The same (F,) of the features with depth, but for those at the edge of a nearer instance; -1 for the rest.

    A stereo window that reaches over such an edge matches what is nearer. Where nothing else shows of an instance, what
    is seen at the edge counts as far as it is farther away than the nearer one. Nearer is what reaches farther down in
    the image: all stands on one ground.
    """
    owners = _owners(features, instances)
    own = np.where(features.has_depth, _owners_at(owners, features.uv), -1)
    far = np.array([_far_side(features.depth[own == i]) for i in range(len(instances))])
    inside = np.flatnonzero(own >= 0)
    bottom = instances.box[own[inside], 3] + _SAME_GROUND_PX
    reach = HALF_WINDOW_PX * features.scale[inside, None] + _ERODED_PX
    at_edge, doubtful = np.zeros((2, len(inside)), np.bool_)
    for direction in _AROUND:
        beside = _owners_at(owners, features.uv[inside] + reach * direction)
        some = np.flatnonzero(beside >= 0)
        some = some[instances.box[beside[some], 3] > bottom[some]]
        at_edge[some] = True
        doubtful[some] |= features.depth[inside[some]] <= far[beside[some]]
    clear = np.bincount(own[inside[~at_edge]], minlength=len(instances))
    own[inside[np.where(clear[own[inside]] < _MIN_DEPTHS, doubtful, at_edge)]] = -1
    return own


def _far_side(depth: NDArray[np.float32]) -> float:
    return float(np.percentile(depth, _FAR_PERCENTILE)) if len(depth) >= _MIN_DEPTHS else 0.0


def _owners(features: CameraFeatures, instances: Detections | Tracks) -> NDArray[np.int16]:
    """Row of the instance at each pixel (H, W), -1 for none."""
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
    return owner


def _far_to_near(features: CameraFeatures, instances: Detections | Tracks) -> NDArray[np.int64]:
    """Rows of the instances, those without depth first."""
    row, column = _pixels(features.uv, *instances.mask.shape[1:])
    inside = instances.mask[:, row, column] & np.isfinite(features.depth)
    median = np.full(len(instances), np.inf)
    for i in np.flatnonzero(np.count_nonzero(inside, axis=1) >= _MIN_DEPTHS):
        median[i] = np.median(features.depth[inside[i]])
    return np.argsort(-median, kind="stable")


def _owners_at(owners: NDArray[np.int16], uv: NDArray[np.floating]) -> NDArray[np.int64]:
    return owners[_pixels(uv, *owners.shape)].astype(np.int64)


def _pixels(uv: NDArray[np.floating], height: int, width: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column (F,) of the pixels that points (F, 2) lie in, or that are nearest to them."""
    pixel = np.rint(uv).astype(np.int64)
    return np.clip(pixel[:, 1], 0, height - 1), np.clip(pixel[:, 0], 0, width - 1)
