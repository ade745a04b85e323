"""The scale pyramid of an image, all levels in one block of memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.world.frame import Image

BLOCK_MARGIN = 64  # bytes after the last level: loops over whole vector registers may read that far


@dataclass(frozen=True, slots=True)
class PyramidLayout:
    """Where each level lies.

    Attributes:
        width, height, offset: (L,) int64, size of each level in pixels and its start in the block.
        scale: (L,) float64, how much smaller the level is than the image, nominally.
        pixel: (L, 2) float64, the exact size of its pixels in x and y: levels have whole widths and heights.
    """

    width: NDArray[np.int64]
    height: NDArray[np.int64]
    offset: NDArray[np.int64]
    scale: NDArray[np.float64]
    pixel: NDArray[np.float64]

    @classmethod
    def of(cls, width: int, height: int, n_levels: int, scale_factor: float) -> PyramidLayout:
        """Layout for images of one size."""
        scale = np.asarray(scale_factor ** np.arange(n_levels), dtype=np.float64)
        widths = np.rint(width / scale).astype(np.int64)
        heights = np.rint(height / scale).astype(np.int64)
        offset = np.concatenate([[0], np.cumsum(widths * heights)[:-1]]).astype(np.int64)
        pixel = np.column_stack([width / widths, height / heights])
        return cls(widths, heights, offset, scale, pixel)

    def to_image(self, xy_level: NDArray[Any], octave: NDArray[np.integer]) -> NDArray[np.float64]:
        """Image pixels (N, 2) of pixels (N, 2) of levels (N,); pixel centres lie at whole numbers on every level.

        Multiplying by the scale, as is often done, is off by half a level's pixel less half an image pixel.
        """
        return np.asarray((xy_level + 0.5) * self.pixel[octave] - 0.5, dtype=np.float64)

    @property
    def size(self) -> int:
        """Pixels of all levels."""
        return int(self.offset[-1] + self.width[-1] * self.height[-1])


class Pyramid:
    """Levels of one image; `block` is the flat memory that compiled code reads."""

    def __init__(self, layout: PyramidLayout) -> None:
        self.layout = layout
        self.block: NDArray[np.uint8] = np.zeros(layout.size + BLOCK_MARGIN, np.uint8)
        self.levels = [
            self.block[o : o + w * h].reshape(h, w)
            for o, w, h in zip(layout.offset, layout.width, layout.height, strict=True)
        ]

    def fill(self, image: Image) -> None:
        """Level 0 is the image, each further level is the one before it, resized."""
        self.levels[0][:] = image
        for below, level in zip(self.levels, self.levels[1:], strict=False):
            cv2.resize(below, (level.shape[1], level.shape[0]), dst=level, interpolation=cv2.INTER_LINEAR)
