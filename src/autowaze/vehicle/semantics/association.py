"""Camera features get the class label and instance id of the mask they lie in (thesis, sec. 3.2.5)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from autowaze.vehicle.semantics.instance_depth import across_box, inverse_depth_lines
from autowaze.vehicle.semantics.mask_lookup import instances_at
from autowaze.world.features import CameraFeatures
from autowaze.world.instances import Tracks
from autowaze.world.labels import ClassLabel

# How far behind the visible surface a point of the thing itself may lie (m): the far corner of a car seen askew.
_BEHIND_M = np.full(len(ClassLabel), 1.0)
_BEHIND_M[ClassLabel.CAR] = 2.5
_BEHIND_M[[ClassLabel.TRUCK, ClassLabel.BUS]] = 6.0
_BEHIND_RELATIVE = 0.06  # depth noise: four standard deviations of half a pixel at 12 m on a 0.54 m baseline


def associate(features: CameraFeatures, tracks: Tracks) -> CameraFeatures:
    """The features with the label and instance id of the mask that each lies in; background elsewhere.

    Masks are eroded by a pixel, the nearer instance wins where masks overlap, and points well behind the instance's
    surface, seen through its windows or past its edge, stay background.
    """
    label = np.zeros(len(features), np.uint8)
    instance_id = np.zeros(len(features), np.int32)
    instance = instances_at(features, tracks)
    inside = np.flatnonzero(instance >= 0)
    row = instance[inside]
    line = inverse_depth_lines(features, tracks.box, instance)[row]
    surface = 1.0 / (line[:, 0] + line[:, 1] * across_box(features.uv[inside], tracks.box[row]))
    behind = features.depth[inside] - surface > _BEHIND_M[tracks.label[row]] + _BEHIND_RELATIVE * surface
    label[inside] = np.where(behind, ClassLabel.BACKGROUND, tracks.label[row])
    instance_id[inside] = np.where(behind, 0, tracks.id[row])
    return replace(features, label=label, instance_id=instance_id)
