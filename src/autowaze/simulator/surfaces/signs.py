"""Traffic signs."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.surfaces.finish import MATTE

_CELL = 128


def paint_signs() -> NDArray[np.uint8]:
    """Four signs side by side: parking, stop, speed limit, give way."""
    atlas = np.full((_CELL, 4 * _CELL, 4), 150, np.uint8)
    atlas[..., 3] = MATTE
    parking, stop, speed, give_way = (atlas[:, i * _CELL : (i + 1) * _CELL] for i in range(4))
    parking[..., :3] = (24, 70, 160)
    cv2.rectangle(parking, (4, 4), (123, 123), (235, 235, 235, MATTE), 4)
    _letters(parking, "P", 3.4, (33, 102), (240, 240, 240))
    stop[..., :3] = (176, 24, 28)
    _letters(stop, "STOP", 1.25, (10, 78), (240, 240, 240))
    speed[..., :3] = (236, 236, 232)
    cv2.circle(speed, (64, 64), 56, (186, 24, 28, MATTE), 13, cv2.LINE_AA)
    _letters(speed, "30", 1.9, (28, 84), (20, 20, 22))
    give_way[..., :3] = (236, 236, 232)
    triangle = np.array([(6, 10), (122, 10), (64, 118)])
    cv2.polylines(give_way, [triangle], True, (186, 24, 28, MATTE), 15, cv2.LINE_AA)
    return atlas


def _letters(tile: NDArray[np.uint8], text: str, scale: float, at: tuple[int, int], ink: tuple[int, int, int]) -> None:
    cv2.putText(tile, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, (*ink, MATTE), int(5 * scale / 1.6), cv2.LINE_AA)
