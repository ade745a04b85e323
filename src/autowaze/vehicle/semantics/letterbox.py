"""Fitting an image into a network's input, and masks back into the image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.world.frame import Image

STRIDE = 32
_GREY = 114  # what YOLO models see around an image in training


@dataclass(frozen=True, slots=True)
class Letterbox:
    """An image scaled without distortion and centred in the network's input.

    Attributes:
        scale: input pixels per image pixel.
        left, top: padding in input pixels.
        width, height: size of the network's input.
    """

    scale: float
    left: int
    top: int
    width: int
    height: int

    @classmethod
    def fixed(cls, image_size: tuple[int, int], width: int, height: int) -> Letterbox:
        """Into an input of given size; `image_size` is (height, width)."""
        return cls._centred(image_size, min(width / image_size[1], height / image_size[0]), width, height)

    @classmethod
    def free(cls, image_size: tuple[int, int], long_side: int) -> Letterbox:
        """Into the smallest input of whole strides, for an export whose input size is free.

        The longer side becomes `long_side` pixels where the image is larger than that; images are never enlarged.
        """
        return cls.strided(image_size, min(1.0, long_side / max(image_size)))

    @classmethod
    def strided(cls, image_size: tuple[int, int], scale: float) -> Letterbox:
        """Into the smallest input of whole strides that holds the scaled image."""
        height, width = (-(-round(side * scale) // STRIDE) * STRIDE for side in image_size)
        return cls._centred(image_size, scale, width, height)

    @classmethod
    def scaled(cls, image_size: tuple[int, int], scale: float) -> Letterbox:
        """Into an input of the scaled image's own size."""
        return cls._centred(image_size, scale, round(image_size[1] * scale), round(image_size[0] * scale))

    @classmethod
    def _centred(cls, image_size: tuple[int, int], scale: float, width: int, height: int) -> Letterbox:
        inner_h, inner_w = (round(side * scale) for side in image_size)
        return cls(scale, (width - inner_w) // 2, (height - inner_h) // 2, width, height)

    def apply(self, image: Image) -> NDArray[np.uint8]:
        """The input as (height, width) or (height, width, 3) uint8."""
        inner_h, inner_w = round(image.shape[0] * self.scale), round(image.shape[1] * self.scale)
        if (inner_h, inner_w) != image.shape[:2]:
            shrink = cv2.INTER_AREA if self.scale < 1.0 else cv2.INTER_LINEAR
            image = np.asarray(cv2.resize(image, (inner_w, inner_h), interpolation=shrink), dtype=np.uint8)
        out = np.full((self.height, self.width, *image.shape[2:]), _GREY, np.uint8)
        out[self.top : self.top + inner_h, self.left : self.left + inner_w] = image
        return out

    def boxes_to_image(self, boxes: NDArray[np.float32], image_size: tuple[int, int]) -> NDArray[np.float32]:
        """Boxes (N, 4) left, top, right, bottom from input to image pixels, clipped to the image."""
        offset = np.array([self.left, self.top, self.left, self.top], np.float32)
        limit = np.array([image_size[1], image_size[0]] * 2, np.float32)
        return np.asarray(np.clip((boxes - offset) / np.float32(self.scale), 0, limit), dtype=np.float32)


def paste_in_box(
    mask: NDArray[np.bool_],
    box: NDArray[np.float32],
    values: NDArray[np.float32],
    values_per_pixel: tuple[float, float],
    offset: tuple[float, float],
    threshold: float,
) -> None:
    """Set the pixels of `mask` (H, W) inside `box` where `values`, laid over the image, exceed the threshold.

    The centre of image pixel x lies at (x + 0.5) * values_per_pixel + offset - 0.5 in the value array, and the same
    for y; between value centres the values are interpolated. Only the box is touched.
    """
    height, width = mask.shape
    # A pixel belongs to the box when its centre does.
    x0, y0, x1, y1 = (int(np.ceil(edge - 0.5)) for edge in box)
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
    if x1 <= x0 or y1 <= y0:
        return
    (sx, sy), (ox, oy) = values_per_pixel, offset
    to_values = np.array([[sx, 0.0, (x0 + 0.5) * sx + ox - 0.5], [0.0, sy, (y0 + 0.5) * sy + oy - 0.5]])
    inside = cv2.warpAffine(
        values,
        to_values,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    mask[y0:y1, x0:x1] |= inside > threshold
