"""Layered noise, the grain of every surface."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float32]
"""(H, W) float32 of mean 0 and variance 1."""


def layered_noise(
    rng: np.random.Generator, height: int, width: int, coarsest: int = 4, octaves: int = 6, persistence: float = 0.6
) -> Field:
    """Fractal noise that tiles: `coarsest` cells across, then octaves of half the size and `persistence` the weight."""
    field = np.zeros((height, width), np.float32)
    weight, cells = 1.0, coarsest
    for _ in range(octaves):
        rows, columns = max(2, cells * height // max(height, width)), max(2, cells * width // max(height, width))
        lattice = rng.standard_normal((rows, columns)).astype(np.float32)
        padded = np.pad(lattice, 2, mode="wrap")
        scaled = cv2.resize(
            padded, ((columns + 4) * width // columns, (rows + 4) * height // rows), interpolation=cv2.INTER_CUBIC
        )
        top, left = 2 * height // rows, 2 * width // columns
        field += weight * scaled[top : top + height, left : left + width]
        weight *= persistence
        cells *= 2
        if cells > max(height, width):
            break
    return np.asarray((field - field.mean()) / max(float(field.std()), 1e-9), dtype=np.float32)


def grain(rng: np.random.Generator, height: int, width: int, blur_px: float = 0.0) -> Field:
    """White noise, softened over some pixels."""
    field = rng.standard_normal((height, width), dtype=np.float32)
    if blur_px > 0:
        field = np.asarray(cv2.GaussianBlur(field, (0, 0), blur_px, borderType=cv2.BORDER_REFLECT_101), np.float32)
    return np.asarray(field / max(float(field.std()), 1e-9), dtype=np.float32)
