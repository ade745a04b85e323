"""What walls collect: posters, vents, meters, plaques, scribbles, ivy, damp."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.surfaces.noise import layered_noise

MARK_CELLS = 36
_SIDE = 6
_CELL = 128


def mark_cell(index: int) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of a mark in its atlas, 0..1."""
    row, column = divmod(index, _SIDE)
    inset = 0.003
    return column / _SIDE + inset, row / _SIDE + inset, (column + 1) / _SIDE - inset, (row + 1) / _SIDE - inset


def paint_marks(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Atlas (768, 768, 4) of 36 marks; RGBA with coverage."""
    atlas = np.zeros((_SIDE * _CELL, _SIDE * _CELL, 4), np.uint8)
    painters = [_poster, _poster, _vent, _meter, _scribble, _scribble, _ivy, _damp, _damp]
    for index in range(MARK_CELLS):
        row, column = divmod(index, _SIDE)
        tile = atlas[row * _CELL : (row + 1) * _CELL, column * _CELL : (column + 1) * _CELL]
        painters[index % len(painters)](tile, rng)
    return atlas


def _colour(rng: np.random.Generator, low: int = 20, high: int = 230) -> tuple[int, int, int, int]:
    r, g, b = (int(v) for v in rng.integers(low, high, 3))
    return r, g, b, 255


def _poster(tile: NDArray[np.uint8], rng: np.random.Generator) -> None:
    left, right = int(rng.integers(6, 30)), int(rng.integers(98, 122))
    cv2.rectangle(tile, (left, 6), (right, 122), _colour(rng, 90, 240), -1)
    for _ in range(int(rng.integers(3, 7))):
        y = int(rng.integers(12, 110))
        cv2.rectangle(
            tile,
            (left + 6, y),
            (int(rng.integers(left + 20, right - 4)), y + int(rng.integers(4, 24))),
            _colour(rng),
            -1,
        )
    cv2.putText(
        tile, str(int(rng.integers(10, 999))), (left + 8, 60), cv2.FONT_HERSHEY_DUPLEX, 1.1, _colour(rng, 0, 90), 3
    )


def _vent(tile: NDArray[np.uint8], rng: np.random.Generator) -> None:
    cv2.rectangle(tile, (20, 34), (108, 94), (128, 130, 130, 255), -1)
    for y in range(42, 92, int(rng.integers(8, 13))):
        cv2.rectangle(tile, (26, y), (102, y + 4), (36, 37, 38, 255), -1)


def _meter(tile: NDArray[np.uint8], rng: np.random.Generator) -> None:
    cv2.rectangle(tile, (34, 16), (94, 112), _colour(rng, 110, 190), -1)
    cv2.rectangle(tile, (34, 16), (94, 112), (52, 53, 54, 255), 3)
    cv2.rectangle(tile, (46, 32), (82, 52), (28, 30, 32, 255), -1)
    cv2.circle(tile, (int(rng.integers(48, 80)), 84), 8, (60, 60, 62, 255), -1)


def _scribble(tile: NDArray[np.uint8], rng: np.random.Generator) -> None:
    colour = _colour(rng, 0, 200)
    for _ in range(int(rng.integers(2, 5))):
        corners = rng.integers(10, 118, (6, 2))
        t = np.linspace(0, 5, 60)
        line = np.stack([np.interp(t, np.arange(6), corners[:, i]) for i in range(2)], -1)
        curve = np.asarray(cv2.GaussianBlur(line.astype(np.float32), (1, 9), 3.0), np.int32)
        cv2.polylines(tile, [curve], False, colour, int(rng.integers(3, 8)), cv2.LINE_AA)


def _ivy(tile: NDArray[np.uint8], rng: np.random.Generator) -> None:
    tile[..., :3] = (48, 66, 34)
    for _ in range(120):
        at = (int(np.clip(rng.normal(64, 24), 8, 120)), int(rng.integers(8, 120)))
        shade = rng.uniform(0.5, 1.3)
        leaf = (int(58 * shade), int(82 * shade), int(38 * shade), 255)
        cv2.ellipse(
            tile, at, (int(rng.integers(4, 9)), int(rng.integers(3, 5))), float(rng.uniform(0, 180)), 0, 360, leaf, -1
        )


def _damp(tile: NDArray[np.uint8], rng: np.random.Generator) -> None:
    size = tile.shape[0]
    distance = np.hypot(*(np.mgrid[0:size, 0:size] - size / 2)) / (size / 2)
    tile[..., :3] = (62, 58, 52)
    tile[..., 3] = (
        150 * np.clip(0.9 - 1.2 * distance + 0.35 * layered_noise(rng, size, size, 4, 6, 0.7), 0, 1)
    ).astype(np.uint8)
