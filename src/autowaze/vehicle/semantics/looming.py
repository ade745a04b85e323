"""How far away vehicles are by the size at which they are seen, over frames: what nears looms (Lee 1976).

Stereo with a baseline of 12 cm errs by two metres at 20 m, and by as much in the next frame. The height of a box in
pixels errs by a twentieth. How high the vehicle is in metres is known badly, but errs the same in all frames: it
cancels out of the way of what keeps its distance, and stretches that of the rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.billboard import HEIGHT_M
from autowaze.vehicle.semantics.displacement import Velocity, median_velocity
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Tracks
from autowaze.world.labels import ClassLabel, is_vehicle
from autowaze.world.pose import Pose

_BORDER_PX = 2.0
_SIGMA_PX, _SIGMA = 1.0, 0.02  # of the height of a box: in pixels, and as a share
_ACROSS_M = 0.35  # the middle of a box is not always over the same part of a vehicle
_HEIGHT_SIGMA, _LEAST_HEIGHT_SIGMA = 0.2, 0.05  # shares, by class alone and by stereo in many frames
_SHARE = 0.2  # of what the stereo of one frame tells of the height: the next ones err alike
_SAME_SHAPE = 0.1  # logarithm by which width over height may change, or something hides a part
_SIGMAS = 3.0


@dataclass(frozen=True)
class SizeSight:
    """One look at a vehicle that is seen whole.

    Attributes:
        timestamp: seconds.
        camera: (2,) where the camera was over ground, metres in the map.
        ray: (2,) over ground, through the middle of the box, per metre of depth.
        depth_per_metre: depth in metres of what is so high in the image and one metre high.
        sigma: its error as a share.
        aspect: logarithm of width over height in the image.
    """

    timestamp: float
    camera: NDArray[np.float64]
    ray: NDArray[np.float64]
    depth_per_metre: float
    sigma: float
    aspect: float


def sights_of(camera: StereoCamera, tracks: Tracks, T_map_cam: Pose, timestamp: float) -> dict[int, SizeSight]:
    """By id, the vehicles that neither the border of the image nor anything nearer hides a part of."""
    if not len(tracks):
        return {}
    left, top, right, bottom = tracks.box.astype(np.float64).T
    limit_x, limit_y = camera.width - 1 - _BORDER_PX, camera.height - 1 - _BORDER_PX
    whole = (left > _BORDER_PX) & (top > _BORDER_PX) & (right < limit_x) & (bottom < limit_y)
    across = (left[:, None] < right[None, :]) & (left[None, :] < right[:, None])
    before = across & (bottom[None, :] > bottom[:, None]) & (top[None, :] < bottom[:, None])
    found = {}
    for i in np.flatnonzero(whole & is_vehicle(tracks.label) & ~before.any(axis=1)):
        width, height = max(right[i] - left[i], 1.0), max(bottom[i] - top[i], 1.0)
        ray = T_map_cam[:2, :3] @ np.array([((left[i] + right[i]) / 2 - camera.cx) / camera.fx, 0.0, 1.0])
        found[int(tracks.id[i])] = SizeSight(
            timestamp,
            T_map_cam[:2, 3].copy(),
            ray,
            camera.fy / height,
            float(np.hypot(_SIGMA_PX * np.sqrt(2.0) / height, _SIGMA)),
            float(np.log(width / height)),
        )
    return found


class Stature:
    """How high a vehicle is: of its class, and by stereo."""

    def __init__(self, label: ClassLabel) -> None:
        self._log_height = float(np.log(HEIGHT_M[label]))
        self._variance = _HEIGHT_SIGMA**2

    def agrees(self, sight: SizeSight, depth: float, depth_sigma: float) -> bool:
        """Whether a look shows the vehicle as high as it is known to be, at the depth that stereo says; learns by it.

        Args:
            depth, depth_sigma: by stereo, metres.
        """
        variance = (depth_sigma / depth) ** 2 + sight.sigma**2
        off = np.log(depth / sight.depth_per_metre) - self._log_height
        if abs(off) > _SIGMAS * np.sqrt(self._variance + variance):
            return False
        gain = self._variance / (self._variance + variance / _SHARE)
        self._log_height += gain * float(off)
        self._variance = max((1.0 - gain) * self._variance, _LEAST_HEIGHT_SIGMA**2)
        return True

    def way(self, sights: Iterable[SizeSight], now: SizeSight, least_s: float) -> Velocity | None:
        """The velocity by the looks that show as much of the vehicle as one now does; None if they span too little."""
        alike = [sight for sight in sights if abs(sight.aspect - now.aspect) <= _SAME_SHAPE]
        if not alike or alike[-1].timestamp - alike[0].timestamp < least_s:
            return None
        to = np.exp(self._log_height) * np.array([sight.depth_per_metre * sight.ray for sight in alike])
        positions = np.array([sight.camera for sight in alike]) + to
        covariance = self._variance * np.outer(to[-1] - to[0], to[-1] - to[0]) + 2.0 * _ACROSS_M**2 * np.eye(2)
        for end in (0, -1):
            covariance += alike[end].sigma ** 2 * np.outer(to[end], to[end])
        return median_velocity(np.array([sight.timestamp for sight in alike]), positions, covariance)
