"""Slivers of vehicles that something nearer lends its depth."""

from __future__ import annotations

import numpy as np

from autowaze.vehicle.semantics.billboard import HEIGHT_M
from autowaze.vehicle.semantics.instance_depth import InstanceDepths
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections
from autowaze.world.labels import is_vehicle

_LOW = 0.5  # of the usual height; at the lent depth a whole vehicle would be so low
_SAME = 0.25  # share by which the depth may be before the middle of the lender, or behind its far end
_BESIDE_PX = 10.0


def without_borrowed(camera: StereoCamera, detections: Detections, depths: InstanceDepths) -> InstanceDepths:
    """Depths (N rows) in which those of slivers beside something nearer are judged by their height instead.

    When a car passes before a parked one, a strip of that one shows first, and all stereo windows in it reach over the
    edge of the car. At that car's depth the strip would be of a vehicle that reaches to one's knees.
    """
    left, top, right, bottom = detections.box.astype(np.float64).T
    by_size = HEIGHT_M[detections.label] * camera.fy / np.maximum(bottom - top, 1.0)
    inside = (left > 0) & (top > 0) & (right < camera.width - 1) & (bottom < camera.height - 1)
    depth = (depths.left + depths.right) / 2
    with np.errstate(invalid="ignore"):
        low = (depth < _LOW * by_size) & inside & is_vehicle(detections.label)
        farthest = np.fmax(depths.far, np.fmax(depths.left, depths.right))
        like = (depth[:, None] > (1 - _SAME) * depth) & (depth[:, None] < (1 + _SAME) * farthest)
    beside = (left[None, :] < right[:, None] + _BESIDE_PX) & (right[None, :] > left[:, None] - _BESIDE_PX)
    lends = like & beside & (bottom[None, :] > bottom[:, None])
    borrowed = low & lends.any(axis=1)
    columns = (depths.left, depths.right, depths.near, depths.far)
    return InstanceDepths(*(np.where(borrowed, by_size, column) for column in columns))
