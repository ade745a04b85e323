"""The sky, and the surroundings that paint and glass mirror, on a paraboloid of the upper half space.

A direction d lands at d.xy / (1 + d.z): the zenith in the middle, the horizon on the unit circle. That needs no
arc tangent in the shader, and no seam.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.light import Illumination
from autowaze.simulator.surfaces.noise import layered_noise

PARABOLOID_REACH = 1.25
"""Half the width of the picture; beyond 1 it shows what lies below the horizon."""


def paint_sky(light: Illumination, rng: np.random.Generator, size: int = 1536) -> NDArray[np.uint8]:
    """(size, size, 4) uint8 picture of the sky; colours are square roots of linear light over 2."""
    direction = _directions(size)
    up = np.clip(direction[..., 2], 0.0, 1.0)
    zenith = np.array(light.sky) * ([0.55, 0.80, 1.25] if light.clouds < 0.9 else [0.92, 0.95, 1.0])
    haze = np.array(light.haze) * (1.15 if light.night < 0.5 else 0.9)
    blend = (1.0 - up) ** 3
    colour = zenith + (haze - zenith) * blend[..., None]
    colour += _clouds(direction, light, rng, size)
    towards_sun = np.clip(direction @ light.to_sun, 0.0, 1.0)
    sun = np.array(light.sun)
    colour += (0.5 * towards_sun**24 + 3.0 * towards_sun**900)[..., None] * sun
    if light.night > 0.5:
        west = np.clip(direction @ np.array([light.to_sun[0], light.to_sun[1], 0.05]), 0.0, 1.0)
        colour += (west**2 * (1 - up) ** 5)[..., None] * np.array([0.75, 0.34, 0.10])
    return _encoded(colour)


def paint_surroundings(
    light: Illumination, sky: NDArray[np.uint8], rng: np.random.Generator, size: int = 512
) -> NDArray[np.uint8]:
    """(size, size, 4) uint8 picture of sky, roof line and street, for reflections."""
    direction = _directions(size)
    colour = (cv2.resize(sky, (size, size), interpolation=cv2.INTER_AREA)[..., :3].astype(np.float32) / 255) ** 2 * 2
    around = np.arctan2(direction[..., 1], direction[..., 0])
    elevation = np.arcsin(np.clip(direction[..., 2], -1, 1))
    steps = 26
    index = ((around / (2 * np.pi) + 0.5) * steps).astype(int) % steps
    roof = rng.uniform(0.10, 0.62, steps)[index]
    walls = (
        np.array([0.36, 0.31, 0.27])
        * rng.uniform(0.4, 1.2, (steps, 1))
        * (np.array(light.sky) + 0.35 * np.array(light.sun))
    )
    wall = walls[index] * np.where((np.floor(elevation * 18) + np.floor(around * 26)) % 2 > 0.5, 1.0, 0.86)[..., None]
    colour = np.where((elevation < roof)[..., None], wall, colour)
    street = np.array(light.ground) * 0.42
    colour = np.where((elevation < 0.02)[..., None], street, colour)
    return _encoded(colour)


def _directions(size: int) -> NDArray[np.float32]:
    axis = ((np.arange(size, dtype=np.float32) + 0.5) / size * 2 - 1) * PARABOLOID_REACH
    x, y = np.meshgrid(axis, axis)
    r2 = x**2 + y**2
    return np.asarray(np.stack([2 * x, 2 * y, 1 - r2], -1) / (1 + r2)[..., None], np.float32)


def _clouds(
    direction: NDArray[np.float32], light: Illumination, rng: np.random.Generator, size: int
) -> NDArray[np.float64]:
    field = layered_noise(rng, 1024, 1024, 3, 7, 0.55)
    # clouds lie in a plane overhead and crowd towards the horizon
    height = np.maximum(direction[..., 2], 0.05)
    plan = direction[..., :2] / height[..., None] * 90.0
    cover = cv2.remap(
        field,
        plan[..., 0].astype(np.float32) % 1024,
        plan[..., 1].astype(np.float32) % 1024,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )
    threshold = 1.4 - 2.4 * light.clouds
    amount = np.clip((cover - threshold) * 0.5, 0.0, 1.0) * np.clip(direction[..., 2] * 6, 0.0, 1.0)
    white = 0.75 * np.array(light.sky) + 0.28 * np.array(light.sun)
    shade = 0.12 * cover if light.clouds > 0.9 else 0.0
    base = amount[..., None] * white * (0.55 if light.clouds < 0.9 else 0.22)
    return np.asarray(
        base
        + (shade * np.clip(direction[..., 2] * 4, 0, 1) * 0.3 if light.clouds > 0.9 else np.zeros((size, size)))[
            ..., None
        ]
    )


def _encoded(colour: NDArray[np.floating]) -> NDArray[np.uint8]:
    values = np.sqrt(np.clip(colour / 2.0, 0.0, 1.0)) * 255 + 0.5
    return np.concatenate([values, np.full((*values.shape[:2], 1), 255.0)], -1).astype(np.uint8)
