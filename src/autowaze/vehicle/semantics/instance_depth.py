"""How far away instances are, by the stereo features in their masks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.mask_lookup import own_surfaces_at
from autowaze.world.columns import Columns
from autowaze.world.features import CameraFeatures
from autowaze.world.instances import Detections, Tracks

_MIN_DEPTHS = 3
_MIN_DEPTHS_FOR_SLOPE, _MIN_SPAN_FOR_SLOPE = 8, 0.4
_NEAR_PERCENTILE, _FAR_PERCENTILE = 10, 90


@dataclass
class InstanceDepths(Columns):
    """Depths of the visible surfaces of N instances along the optical axis, metres; NaN where unknown.

    Attributes:
        left, right: (N,) float64 at the left and right edge of the box.
        near, far: (N,) float64, range of the features inside the mask, whatever they lie on.
    """

    left: NDArray[np.float64]
    right: NDArray[np.float64]
    near: NDArray[np.float64]
    far: NDArray[np.float64]

    @classmethod
    def unknown(cls, n: int) -> InstanceDepths:
        """Nothing known of n instances."""
        nan = np.full(n, np.nan)
        return cls(nan, nan, nan, nan)


def measure_depths(features: CameraFeatures, instances: Detections | Tracks) -> InstanceDepths:
    """Depths of the instances; unknown where fewer than three features with depth lie in the mask."""
    instance = own_surfaces_at(features, instances)
    lines = inverse_depth_lines(features, instances.box, instance)
    near, far = np.full((2, len(instances)), np.nan)
    for i in np.flatnonzero(np.isfinite(lines[:, 0])):
        inside = features.depth[(instance == i) & features.has_depth]
        near[i], far[i] = np.percentile(inside, (_NEAR_PERCENTILE, _FAR_PERCENTILE))
    return InstanceDepths(1.0 / (lines[:, 0] - lines[:, 1] / 2), 1.0 / (lines[:, 0] + lines[:, 1] / 2), near, far)


def across_box(uv: NDArray[np.float32], boxes: NDArray[np.float32]) -> NDArray[np.float64]:
    """Column (N,) of each feature within its box, -0.5 at the left edge to 0.5 at the right."""
    width = np.maximum(boxes[:, 2] - boxes[:, 0], 1.0)
    return np.asarray(np.clip((uv[:, 0] - boxes[:, 0]) / width - 0.5, -0.5, 0.5), dtype=np.float64)


def inverse_depth_lines(
    features: CameraFeatures, boxes: NDArray[np.float32], instance: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Inverse depth (1/m) at the middle of each box and its change from left to right edge, (N, 2); NaN if unknown."""
    lines = np.full((len(boxes), 2), np.nan)
    usable = np.flatnonzero((instance >= 0) & features.has_depth)
    usable = usable[np.argsort(instance[usable], kind="stable")]
    bounds = np.searchsorted(instance[usable], np.arange(len(boxes) + 1))
    across = across_box(features.uv[usable], boxes[instance[usable]])
    inverse = 1.0 / features.depth[usable].astype(np.float64)
    for i, (start, stop) in enumerate(pairwise(bounds)):
        if stop - start >= _MIN_DEPTHS:
            lines[i] = _robust_line(across[start:stop], inverse[start:stop])
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
    left, right = np.clip((intercept - slope / 2, intercept + slope / 2), y.min(), y.max())
    return float(left + right) / 2, float(right - left)
