"""What can be set about SLAM."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.loops.settings import LoopSettings
from autowaze.world.features import LEVEL_SCALE


@dataclass(frozen=True, slots=True)
class SlamSettings:
    """Tracking and mapping; the defaults follow ORB-SLAM2 (Mur-Artal & Tardos 2017) where it names a number.

    Attributes:
        n_levels, scale_factor: of the ORB pyramid.
        corner_sigma_px, disparity_sigma_px: standard deviations at level 0, coarser levels in proportion. After bundle
            adjustment the inliers' residuals spread by 0.18 and 0.11 px (median absolute deviation), at every level and
            on every drive; more than twice that leaves room for what residuals do not show.
        close_baselines: disparities hold the pose up to this depth (ORB-SLAM2: 35 baselines). Real rigs are rectified
            to a tenth or two of a pixel, the same for all features of an image region, so it does not average out:
            farther away it is a large error of the scale, and directions tell more.
        max_hamming: most differing bits of a match. ratio: best over second best.
        min_start_features: stereo features needed to begin a map (ORB-SLAM2: 500, of 2000).
        min_inliers: fewer do not hold a pose (ORB-SLAM2: 30).
        min_stored_inliers: features of the stored map that make a pose a localisation.
        min_static_inliers: from so many on, things that may drive away do not steer the pose at all.
        movable_weight: how much they count until then, and in bundle adjustment.
        own_weight: how much landmarks of this drive count where enough of the stored map is seen.
        min_relocalized_inliers: features that make certain of a place found by appearance (ORB-SLAM2: 50).
        restart_after: frames with enough features but no known place, after which odometry starts afresh.
        max_depth_baselines: landmarks are made up to this many baselines away.
        adjustment_frames: the bundle adjustment of a keyframe is applied so many frames later, whenever it ended, so
            that no result depends on the speed of the machine; meanwhile no other one starts.
        keyframe_ratio: tracked landmarks below this share of the last keyframe's make a new one.
        keyframe_distance_m, keyframe_angle_rad: as does so much motion.
        n_adjusted, n_fixed: keyframes that bundle adjustment moves, and older ones that hold it.
        memory_s: landmarks of this drive that were not seen for so long are forgotten, so that a drive may last.
        local_radius_m: features of the stored map within it are looked for.
        loops: of loop closing.
    """

    n_levels: int = 8
    scale_factor: float = LEVEL_SCALE
    corner_sigma_px: float = 0.4
    disparity_sigma_px: float = 0.3
    close_baselines: float = 20.0
    max_hamming: int = 80
    ratio: float = 0.85
    min_start_features: int = 200
    min_inliers: int = 30
    min_stored_inliers: int = 30
    min_static_inliers: int = 60
    movable_weight: float = 0.1
    own_weight: float = 0.25
    min_relocalized_inliers: int = 50
    restart_after: int = 10
    max_depth_baselines: float = 720.0
    adjustment_frames: int = 2
    keyframe_ratio: float = 0.4
    keyframe_distance_m: float = 0.25
    keyframe_angle_rad: float = 0.03
    n_adjusted: int = 5
    n_fixed: int = 5
    memory_s: float = 20.0
    local_radius_m: float = 60.0
    loops: LoopSettings = field(default_factory=LoopSettings)

    @property
    def n_local_keyframes(self) -> int:
        """The latest keyframes, whose landmarks are looked for."""
        return self.n_adjusted + self.n_fixed

    @property
    def level_scale(self) -> NDArray[np.float64]:
        """Size of each pyramid level's pixels in pixels of the image, (L,)."""
        return np.asarray(self.scale_factor ** np.arange(self.n_levels), dtype=np.float64)
