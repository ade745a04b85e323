"""Leaves."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def paint_leaves(rng: np.random.Generator, autumn: float = 0.0, size: int = 512) -> NDArray[np.uint8]:
    """A cluster of leaves with gaps; RGBA with coverage."""
    tile = np.zeros((size, size, 4), np.uint8)
    tile[..., :3] = (52, 70, 34)
    green = np.array([74, 100, 42]) * (1 - autumn) + np.array([150, 108, 40]) * autumn
    for layer in range(3):
        for _ in range(95):
            angle, reach = rng.uniform(0, 2 * np.pi), size * 0.46 * rng.random() ** 0.6
            at = (int(size / 2 + reach * np.cos(angle)), int(size / 2 + reach * np.sin(angle)))
            colour = np.clip(green * rng.uniform(0.55, 0.85) * (0.8 + 0.25 * layer) + rng.normal(0, 5, 3), 0, 255)
            axes = (int(rng.integers(11, 21)), int(rng.integers(5, 10)))
            cv2.ellipse(tile, at, axes, float(rng.uniform(0, 180)), 0, 360, (*(int(c) for c in colour), 255), -1)
    return tile


def paint_hedge(rng: np.random.Generator, size: int = 512) -> NDArray[np.uint8]:
    """Clipped hedge, dense; tiles roughly."""
    from autowaze.simulator.surfaces.finish import MATTE

    tile = np.zeros((size, size, 4), np.uint8)
    tile[:] = (22, 32, 16, MATTE)
    for _ in range(3600):
        at = (int(rng.integers(0, size)), int(rng.integers(0, size)))
        colour = np.clip(np.array([62, 88, 38]) * rng.uniform(0.45, 1.25), 0, 255)
        axes = (int(rng.integers(5, 11)), int(rng.integers(3, 5)))
        cv2.ellipse(tile, at, axes, float(rng.uniform(0, 180)), 0, 360, (*(int(c) for c in colour), MATTE), -1)
    return tile
