"""Camera features get the class label and instance id of the mask they lie in (thesis, sec. 3.2.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world.features import CameraFeatures
from autowaze.world.instances import Detections, Tracks


def associate(features: CameraFeatures, tracks: Tracks) -> CameraFeatures:
    """The features with the label and instance id of the mask that each lies in; background elsewhere."""
    raise NotImplementedError


def edge_depths(detections: Detections, features: CameraFeatures) -> NDArray[np.float64]:
    """Depths (N, 2) in metres of each detection's surface at the left and right edge of its box; NaN if unknown."""
    raise NotImplementedError
