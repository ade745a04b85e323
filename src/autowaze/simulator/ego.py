"""How the ego vehicle moves: speed, braking for bends, and a body that pitches, rolls and shakes a little."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from autowaze.simulator.curve import Curve
from autowaze.simulator.description import Ego, StreetDescription
from autowaze.simulator.plan.roads import LANE_M
from autowaze.world.pose import heading_to_rotation, make_pose, so3_exp

_STEP_M = 0.25
_ACCELERATION, _BRAKING, _LATERAL = 1.3, 1.8, 2.2
"""Comfortable driving, m/s^2."""
_PITCH_PER_ACCELERATION, _ROLL_PER_ACCELERATION = np.radians(0.55), np.radians(0.45)
"""A family car's body leans about so much per m/s^2."""
_SHAKE_RAD, _HEAVE_M = np.radians(0.10), 0.006
_SHAKE_WAVELENGTH_M = 1.6


@dataclass(frozen=True)
class EgoMotion:
    """The ego vehicle's drive on a fine grid along its path.

    Attributes:
        path: of the camera, map metres.
        time, s, speed: of the grid, seconds from the start, metres, m/s.
        pitch, roll, heave: of the camera on the grid, radians (pitch positive looks up) and metres.
        timestamps: of the frames, seconds since the epoch.
    """

    path: Curve
    time: NDArray[np.float64]
    s: NDArray[np.float64]
    speed: NDArray[np.float64]
    pitch: NDArray[np.float64]
    roll: NDArray[np.float64]
    heave: NDArray[np.float64]
    mount_height_m: float
    timestamps: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.timestamps)

    @property
    def frame_times(self) -> NDArray[np.float64]:
        """Seconds from the start, (F,)."""
        return np.asarray(self.timestamps - self.timestamps[0])

    def position(self, time: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Points (..., 2) on the road at times from the start."""
        return self.path.at(np.asarray(np.interp(time, self.time, self.s)))

    def pose(self, time: float) -> NDArray[np.float64]:
        """T_map_cam at a time from the start; before it the vehicle came at its first speed."""
        s = float(np.interp(time, self.time, self.s)) + min(time, 0.0) * float(self.speed[0])
        pitch, roll, heave = (float(np.interp(s, self.s, column)) for column in (self.pitch, self.roll, self.heave))
        x, y = self.path.at(s)
        level = heading_to_rotation(float(np.pi / 2 - self.path.heading(s)))
        return make_pose(level @ so3_exp(np.array([pitch, 0.0, roll])), np.array([x, y, self.mount_height_m + heave]))

    def poses(self) -> NDArray[np.float64]:
        """T_map_cam (F, 4, 4) of all frames."""
        return np.stack([self.pose(float(t)) for t in self.frame_times])


def drive_along(
    route: Curve, description: StreetDescription, rng: np.random.Generator, hold: tuple[float, ...] = ()
) -> EgoMotion:
    """Drive the route; `hold` are distances before which the vehicle brakes to half its speed."""
    ego = description.ego
    start = min(ego.start_m, route.length - 2.0)
    path = _shifted(route.part(start, route.length), ego)
    s = np.arange(0.0, path.length, _STEP_M)
    limit = np.full(len(s), ego.speed_kmh / 3.6)
    bend = np.abs(gaussian_filter1d(path.curvature(s), 1.0 / _STEP_M))
    limit = np.minimum(limit, np.sqrt(_LATERAL / np.maximum(bend, 1e-4)))
    for place in hold:
        limit = np.where(np.abs(s - place) < 3.0, 0.5 * limit, limit)
    # nobody holds a speed exactly
    limit *= 1.0 + 0.04 * _shaken(rng, s, 25.0)
    speed = _feasible(limit)
    time = np.concatenate([[0.0], np.cumsum(_STEP_M / ((speed[1:] + speed[:-1]) / 2))])
    acceleration = gaussian_filter1d(np.gradient(speed, time), 2.0 / _STEP_M)
    lateral = speed**2 * gaussian_filter1d(path.curvature(s), 2.0 / _STEP_M)
    pitch = _PITCH_PER_ACCELERATION * acceleration + _SHAKE_RAD * _shaken(rng, s, _SHAKE_WAVELENGTH_M)
    roll = -_ROLL_PER_ACCELERATION * lateral + 0.7 * _SHAKE_RAD * _shaken(rng, s, _SHAKE_WAVELENGTH_M)
    heave = _HEAVE_M * _shaken(rng, s, _SHAKE_WAVELENGTH_M)
    frames = int(time[-1] * ego.fps) + 1
    frames = min(frames, ego.frames or frames)
    return EgoMotion(
        path,
        time,
        s,
        speed,
        pitch - np.radians(description.rig.pitch_deg),
        roll,
        heave,
        description.rig.mount_height_m,
        ego.start_time + np.arange(frames) / ego.fps,
    )


def _shifted(path: Curve, ego: Ego) -> Curve:
    """The path beside itself, or from its end in the other lane."""
    if ego.opposite:
        path = path.offset(LANE_M).reversed()
    return path.offset(ego.left_m) if ego.left_m else path


def _feasible(limit: NDArray[np.float64]) -> NDArray[np.float64]:
    """The highest speeds under a limit that braking and acceleration allow."""
    speed = limit.copy()
    for i in range(1, len(speed)):
        speed[i] = min(speed[i], np.sqrt(speed[i - 1] ** 2 + 2 * _ACCELERATION * _STEP_M))
    for i in range(len(speed) - 2, -1, -1):
        speed[i] = min(speed[i], np.sqrt(speed[i + 1] ** 2 + 2 * _BRAKING * _STEP_M))
    return np.maximum(speed, 0.5)


def _shaken(rng: np.random.Generator, s: NDArray[np.float64], wavelength_m: float) -> NDArray[np.float64]:
    """Smooth noise of variance 1 along the way."""
    raw = gaussian_filter1d(rng.standard_normal(len(s) + 64), wavelength_m / _STEP_M / 4)[32:-32]
    return np.asarray((raw - raw.mean()) / max(float(raw.std()), 1e-9))
