"""What the image sensor adds: shot and read noise, and a rectification that is never quite right."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.description import Effects
from autowaze.world.frame import Image, to_grey
from autowaze.world.pose import so3_exp

_READ_NOISE, _SHOT_NOISE = 0.9, 0.13
"""Standard deviations in grey levels: of the dark image, and per square root of a level."""
_BANK_MARGIN = (384, 1536)


class Sensor:
    """Noise for one drive; frame by frame the same for the same seed, in any order."""

    def __init__(self, effects: Effects, seed: int) -> None:
        self._effects, self._seed = effects, seed
        rng = np.random.default_rng([seed, 6])
        self._bank = np.zeros((0, 0), np.float32)
        levels = np.arange(256)
        sigma = effects.noise * np.hypot(_READ_NOISE, _SHOT_NOISE * np.sqrt(levels))
        self._sigma = sigma.astype(np.float32)
        self._phase = rng.uniform(0, 2 * np.pi, 3)
        self._fixed = rng.normal(0, 1, 3)

    def expose(self, picture: Image, frame: int, camera: int) -> Image:
        """A picture (H, W, 3) with noise; grey (H, W) if the camera is."""
        image = to_grey(picture) if self._effects.grey else picture
        if self._effects.noise <= 0:
            return image
        flat = image.reshape(image.shape[0], -1)
        rng = np.random.default_rng([self._seed, 7, frame, camera])
        noise = self._piece(flat.shape, rng)
        sigma = cv2.LUT(flat, self._sigma)
        noisy = cv2.add(flat, cv2.multiply(noise, sigma), dtype=cv2.CV_8U)
        return np.asarray(noisy, np.uint8).reshape(image.shape)

    def _piece(self, shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
        """A piece of the noise bank, which is larger than a picture, taken anew for every picture."""
        size = (shape[0] + _BANK_MARGIN[0], shape[1] + _BANK_MARGIN[1])
        if self._bank.shape != size:
            bank = np.random.default_rng([self._seed, 9]).standard_normal(size, np.float32)
            self._bank = np.clip(bank, -3.9, 3.9, out=bank)
        row, column = (int(rng.integers(0, margin)) for margin in _BANK_MARGIN)
        return self._bank[row : row + shape[0], column : column + shape[1]]

    def wobble(self, frame: int, fx: float) -> NDArray[np.float64]:
        """Rotation (3, 3) that rectification left between the cameras in a frame: a fixed part and a slow drift."""
        size = self._effects.rectification_residual_px / fx
        drift = 0.5 * np.sin(0.05 * frame + self._phase)
        return so3_exp(size * (0.6 * self._fixed + drift) * [1.0, 0.3, 1.0])


def paint_lens_dirt(rng: np.random.Generator, size: int = 256) -> NDArray[np.uint8]:
    """(size, size, 4) picture of smears and drops on the lens; red says how much."""
    dirt = np.zeros((size, size), np.float32)
    for _ in range(26):
        centre = tuple(int(v) for v in rng.integers(0, size, 2))
        axes = (int(rng.uniform(2, 22)), int(rng.uniform(2, 9)))
        cv2.ellipse(dirt, centre, axes, float(rng.uniform(0, 180)), 0, 360, float(rng.uniform(0.3, 1.0)), -1)
    dirt = np.asarray(cv2.GaussianBlur(dirt, (0, 0), 4.0), np.float32)
    return np.repeat((255 * np.clip(dirt, 0, 1)).astype(np.uint8)[..., None], 4, axis=2)
