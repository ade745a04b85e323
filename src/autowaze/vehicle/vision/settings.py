"""What can be set about feature extraction."""

from __future__ import annotations

from dataclasses import dataclass

from autowaze.world.features import LEVEL_SCALE


@dataclass(frozen=True, slots=True)
class VisionSettings:
    """ORB extraction and stereo matching; the defaults suit a road vehicle's camera of 0.5 megapixels.

    Attributes:
        n_features: left features kept.
        n_levels: pyramid levels, each smaller than the last by `scale_factor` (ORB-SLAM2: 8 and 1.2).
        fast_threshold: corners need this grey-level step; a low one and the spreading keep dark vehicles in shadow.
        min_depth_m: nothing is nearer to a road vehicle's camera.
        min_disparity_px: below it depth is noise; points so far away serve as directions only.
    """

    n_features: int = 2000
    n_levels: int = 8
    scale_factor: float = LEVEL_SCALE
    fast_threshold: int = 7
    min_depth_m: float = 2.0
    min_disparity_px: float = 1.0
