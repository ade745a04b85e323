"""Sun, sky and haze at a time of day and in a kind of weather."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.description import Light

Radiance = tuple[float, float, float]


@dataclass(frozen=True)
class Illumination:
    """Light in linear RGB, 1 being what a sunlit white wall sends back.

    Attributes:
        to_sun: (3,) unit vector, east, north, up.
        sun: of the direct light.
        sky: from above, where the sky is.
        ground: from below, reflected by the street.
        haze: colour of the air far away; `haze_per_m` its density.
        exposure: of the camera.
        clouds: share of the sky that they cover.
        night: 0 by day, 1 when lamps and windows are lit.
    """

    to_sun: NDArray[np.float64]
    sun: Radiance
    sky: Radiance
    ground: Radiance
    haze: Radiance
    haze_per_m: float
    exposure: float
    clouds: float
    night: float


def sun_direction(light: Light, latitude_deg: float) -> NDArray[np.float64]:
    """Unit vector to the sun, east, north, up (declination by Cooper's formula, 1969)."""
    day = date.fromisoformat(light.date).timetuple().tm_yday
    declination = np.radians(23.45) * np.sin(2 * np.pi * (284 + day) / 365)
    hour = np.radians(15.0 * (light.solar_time - 12.0))
    latitude = np.radians(latitude_deg)
    east = -np.cos(declination) * np.sin(hour)
    north = np.cos(latitude) * np.sin(declination) - np.sin(latitude) * np.cos(declination) * np.cos(hour)
    up = np.sin(latitude) * np.sin(declination) + np.cos(latitude) * np.cos(declination) * np.cos(hour)
    return np.array([east, north, up])


def illuminate(light: Light, latitude_deg: float, exposure: float, rng: np.random.Generator) -> Illumination:
    """The light of a drive; small changes of colour come from the generator."""
    to_sun = sun_direction(light, latitude_deg)
    height = max(float(to_sun[2]), 0.12)
    flat = np.hypot(to_sun[0], to_sun[1])
    # a sun below 7 degrees would leave the street to its own shadow: that is what dusk is for
    to_sun = np.array([to_sun[0] / flat * np.sqrt(1 - height**2), to_sun[1] / flat * np.sqrt(1 - height**2), height])
    warmth = float(np.exp(-3.5 * height))
    sun = np.array([1.0, 0.96 - 0.22 * warmth, 0.88 - 0.50 * warmth]) * (1.75 - 0.5 * warmth)
    sky = np.array([0.31, 0.36, 0.45]) * (0.70 + 0.35 * height)
    clouds, haze_per_m, night = float(rng.uniform(0.1, 0.5)), 0.0009, 0.0
    haze = np.array([0.62, 0.70, 0.80])
    if light.weather == "hazy":
        sun, sky, clouds, haze_per_m = 0.62 * sun, 1.15 * sky + 0.05, 0.75, 0.0028
        haze = np.array([0.72, 0.75, 0.78])
    elif light.weather == "overcast":
        sun, clouds, haze_per_m = 0.0 * sun, 1.0, 0.0018
        sky = np.array([0.86, 0.90, 0.96]) * float(rng.uniform(0.85, 1.05))
        haze = np.array([0.70, 0.74, 0.78])
    elif light.weather == "dusk":
        sun, clouds, haze_per_m, night = 0.0 * sun, 0.6, 0.0020, 1.0
        sky, haze = np.array([0.20, 0.24, 0.36]), np.array([0.34, 0.33, 0.40])
    ground = 0.42 * sky * [1.0, 0.96, 0.90] + 0.13 * sun * height
    gain = {"clear": 1.0, "hazy": 1.05, "overcast": 1.05, "dusk": 1.6}[light.weather] * exposure
    return Illumination(
        to_sun,
        _rgb(sun),
        _rgb(sky),
        _rgb(ground),
        _rgb(haze),
        haze_per_m,
        gain * float(rng.uniform(0.94, 1.06)),
        clouds,
        night,
    )


def _rgb(values: NDArray[np.float64]) -> Radiance:
    return float(values[0]), float(values[1]), float(values[2])
