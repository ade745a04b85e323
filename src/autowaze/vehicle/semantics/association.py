"""Camera features get the class label and instance id of the mask they lie in (thesis, sec. 3.2.5)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.world.features import CameraFeatures
from autowaze.world.instances import Detections, Tracks
from autowaze.world.labels import ClassLabel

_ERODED_PX = 1  # masks spill over the silhouette by a pixel or two, where corners of the background lie
_MIN_DEPTHS = 3
_MIN_DEPTHS_FOR_SLOPE, _MIN_SPAN_FOR_SLOPE = 8, 0.4

# How far behind the fitted surface a point of the thing itself may lie (m): the far corner of a car seen askew.
_BEHIND_M = np.full(len(ClassLabel), 1.0)
_BEHIND_M[ClassLabel.CAR] = 2.5
_BEHIND_M[[ClassLabel.TRUCK, ClassLabel.BUS]] = 6.0
_BEHIND_RELATIVE = 0.06  # depth noise: four standard deviations of half a pixel at 12 m on a 0.54 m baseline


def associate(features: CameraFeatures, tracks: Tracks) -> CameraFeatures:
    """The features with the label and instance id of the mask that each lies in; background elsewhere.

    Masks are eroded by a pixel, the nearer instance wins where masks overlap, and points well behind the instance's
    surface stay background.
    """
    instance = _instance_at(features.uv, tracks, _nearest_last(features, tracks))
    inside = instance >= 0
    label = np.where(inside, tracks.label[instance], ClassLabel.BACKGROUND) if len(tracks) else features.label * 0
    if len(tracks):
        surface = _surface_depth(features, tracks.box, instance)
        behind = features.depth - surface > _BEHIND_M[label] + _BEHIND_RELATIVE * surface
        inside &= ~behind
    ids = np.where(inside, tracks.id[instance], 0) if len(tracks) else np.zeros(len(features), np.int32)
    return CameraFeatures(
        features.uv,
        features.octave,
        features.angle,
        features.descriptor,
        features.u_right,
        features.depth,
        features.position_cam,
        np.where(inside, label, ClassLabel.BACKGROUND).astype(np.uint8),
        ids.astype(np.int32),
    )


def edge_depths(instances: Detections | Tracks, features: CameraFeatures) -> NDArray[np.float64]:
    """Depths (N, 2) in metres of each instance's surface at the left and right edge of its box.

    NaN where fewer than three features with depth lie in the mask.
    """
    instance = _instance_at(features.uv, instances, _nearest_last(features, instances))
    line = _inverse_depth_lines(features, instances.box, instance)
    return np.asarray(1.0 / (line[:, :1] + line[:, 1:] * np.array([[-0.5, 0.5]])))


def _pixels(uv: NDArray[np.float32], shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column (N,) of the pixels that features lie in, clipped to the image."""
    pixel = np.rint(uv).astype(np.int64)
    return np.clip(pixel[:, 1], 0, shape[-2] - 1), np.clip(pixel[:, 0], 0, shape[-1] - 1)


def _nearest_last(features: CameraFeatures, instances: Detections | Tracks) -> NDArray[np.int64]:
    """Rows of the instances from far to near by the median depth in their masks, those without depth first."""
    row, column = _pixels(features.uv, instances.mask.shape)
    depth = np.where(instances.mask[:, row, column], features.depth, np.nan)
    known = np.isfinite(depth).sum(axis=1) >= _MIN_DEPTHS
    median = np.full(len(instances), np.inf)
    median[known] = np.nanmedian(depth[known], axis=1)
    return np.argsort(-median, kind="stable")


def _instance_at(
    uv: NDArray[np.float32], instances: Detections | Tracks, order: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Row (F,) of the instance whose eroded mask holds each feature, the last in `order` where several do; else -1."""
    height, width = instances.mask.shape[1:]
    owner = np.full((height, width), -1, np.int16)
    kernel = np.ones((2 * _ERODED_PX + 1, 2 * _ERODED_PX + 1), np.uint8)
    for i in order:
        x0, y0 = np.maximum(np.floor(instances.box[i, :2]).astype(int), 0)
        x1, y1 = np.ceil(instances.box[i, 2:]).astype(int)
        part = np.ascontiguousarray(instances.mask[i, y0:y1, x0:x1]).view(np.uint8)
        if part.size:
            eroded = cv2.erode(part, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=1)
            owner[y0:y1, x0:x1][eroded > 0] = i
    row, column = _pixels(uv, owner.shape)
    return owner[row, column].astype(np.int64)


def _surface_depth(
    features: CameraFeatures, boxes: NDArray[np.float32], instance: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Depth (F,) of the fitted surface of its instance at each feature; NaN outside instances."""
    line = _inverse_depth_lines(features, boxes, instance)[instance]
    inverse_depth = line[:, 0] + line[:, 1] * _across(features.uv, boxes[instance])
    return np.where(instance >= 0, 1.0 / inverse_depth, np.nan)


def _across(uv: NDArray[np.float32], boxes: NDArray[np.float32]) -> NDArray[np.float64]:
    """Column of each feature within its box, -0.5 at the left edge to 0.5 at the right."""
    width = np.maximum(boxes[:, 2] - boxes[:, 0], 1.0)
    return np.asarray(np.clip((uv[:, 0] - boxes[:, 0]) / width - 0.5, -0.5, 0.5), dtype=np.float64)


def _inverse_depth_lines(
    features: CameraFeatures, boxes: NDArray[np.float32], instance: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Inverse depth (1/m) at the middle of each box and its change from left to right edge, (N, 2); NaN if unknown."""
    lines = np.full((len(boxes), 2), np.nan)
    usable = np.flatnonzero((instance >= 0) & features.has_depth)
    usable = usable[np.argsort(instance[usable], kind="stable")]
    starts = np.searchsorted(instance[usable], np.arange(len(boxes) + 1))
    across = _across(features.uv[usable], boxes[instance[usable]]) if len(usable) else np.zeros(0)
    inverse = 1.0 / features.depth[usable].astype(np.float64)
    for i in range(len(boxes)):
        part = slice(starts[i], starts[i + 1])
        if starts[i + 1] - starts[i] >= _MIN_DEPTHS:
            lines[i] = _robust_line(across[part], inverse[part])
    return lines


def _robust_line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Intercept and slope of y over x in -0.5..0.5, near the median; the ends stay within the values seen."""
    middle = np.median(y)
    spread = max(1.5 * float(np.median(np.abs(y - middle))), 0.02 * float(middle))
    good = np.abs(y - middle) <= 3.0 * spread
    x, y = x[good], y[good]
    if len(x) < _MIN_DEPTHS_FOR_SLOPE or np.ptp(x) < _MIN_SPAN_FOR_SLOPE:
        return float(middle), 0.0
    slope, intercept = np.polyfit(x, y, 1)
    low, high = y.min(), y.max()
    left, right = np.clip((intercept - slope / 2, intercept + slope / 2), low, high)
    return float(left + right) / 2, float(right - left)
