"""What a satellite receiver says between houses: a bias that wanders, and noise."""

from __future__ import annotations

import numpy as np

from autowaze.simulator.ego import EgoMotion
from autowaze.world.frame import GnssFix
from autowaze.world.georeference import Georeference

_BIAS_SIGMA_M, _BIAS_TIME_S = 1.3, 40.0
_NOISE_SIGMA_M, _HEADING_SIGMA_RAD = 0.35, np.radians(1.5)
_COURSE_FROM_MPS = 1.5
"""Below this speed a receiver's course over ground is useless."""


def receive_fixes(ego: EgoMotion, georeference: Georeference, rng: np.random.Generator) -> list[GnssFix]:
    """One fix per frame (first-order Gauss-Markov bias)."""
    poses = ego.poses()
    times = ego.frame_times
    keep = np.exp(-np.diff(times, prepend=times[0]) / _BIAS_TIME_S)
    bias = rng.normal(0, _BIAS_SIGMA_M, 3)
    places, headings = [], []
    for T, k in zip(poses, keep, strict=True):
        bias = k * bias + np.sqrt(1 - k * k) * rng.normal(0, _BIAS_SIGMA_M, 3)
        noise = rng.normal(0, _NOISE_SIGMA_M, 3)
        places.append(T[:3, 3] + (bias + noise) * [1.0, 1.0, 1.8])
        headings.append(float(np.arctan2(T[0, 2], T[1, 2]) + rng.normal(0, _HEADING_SIGMA_RAD)))
    lon_lat = georeference.to_lon_lat(np.array(places))
    speed = np.interp(times, ego.time, ego.speed)
    sigma = float(np.hypot(_BIAS_SIGMA_M, _NOISE_SIGMA_M))
    return [
        GnssFix(
            lon_deg=float(lon),
            lat_deg=float(lat),
            altitude_m=float(georeference.altitude_m + place[2]),
            horizontal_sigma_m=round(sigma, 2),
            heading_rad=heading if v > _COURSE_FROM_MPS else None,
        )
        for (lon, lat), place, heading, v in zip(lon_lat, places, headings, speed, strict=True)
    ]
