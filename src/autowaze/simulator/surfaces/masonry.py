"""Walls and roofs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.surfaces.finish import TINTED
from autowaze.simulator.surfaces.ground import opaque
from autowaze.simulator.surfaces.noise import grain, layered_noise

WALL_M = 6.4
"""Metres that one repeat of a wall covers."""

WALL_COLOURS = {
    "brick": [(166, 88, 66), (150, 98, 76), (188, 140, 104), (128, 84, 70), (196, 168, 132), (140, 70, 58)],
    "render": [
        (226, 218, 200),
        (236, 232, 224),
        (222, 200, 160),
        (206, 190, 170),
        (196, 206, 196),
        (214, 186, 158),
        (186, 192, 200),
    ],
    "stone": [(206, 194, 172), (182, 174, 160), (214, 206, 190), (164, 158, 150)],
    "boards": [(226, 226, 220), (160, 178, 190), (196, 180, 150), (130, 148, 130), (178, 96, 80), (214, 204, 160)],
}


def paint_wall(kind: str, rng: np.random.Generator, size: int = 1024) -> NDArray[np.uint8]:
    """A tintable wall: brick, render, stone or boards; tiles."""
    painter = {"brick": _brick, "render": _render, "stone": _stone, "boards": _boards}[kind]
    field = painter(rng, size)
    # rain leaves streaks
    streaks = np.repeat(layered_noise(rng, 8, size, 12, 5), size // 8, axis=0)
    field = field + 3.0 * streaks + 4.0 * layered_noise(rng, size, size, 2, 5)
    return opaque(field, (1.0, 1.0, 1.0), TINTED)


def _courses(size: int, rows: int, columns: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    y, x = np.mgrid[0:size, 0:size]
    h, w = size / rows, size / columns
    row = (y / h).astype(np.int64)
    shifted = (x + (row % 2) * w / 2) % size
    column = (shifted / w).astype(np.int64) % columns
    edge = np.minimum(np.minimum(y % h, h - y % h), np.minimum(shifted % w, w - shifted % w))
    return row % rows, column, edge


def _brick(rng: np.random.Generator, size: int) -> NDArray[np.float64]:
    rows, columns = 96, 28
    row, column, edge = _courses(size, rows, columns)
    tone = rng.normal(0, 22, (rows, columns)) - 60 * (rng.random((rows, columns)) < 0.07)
    field = 186 + tone[row, column] + 10 * grain(rng, size, size, 0.6)
    soot = 10 * layered_noise(rng, size, size, 5, 6, 0.7)
    return np.asarray(np.where(edge < 1.0, 244 + 6 * grain(rng, size, size), field) + soot)


def _render(rng: np.random.Generator, size: int) -> NDArray[np.float64]:
    field = (
        214
        + 7 * grain(rng, size, size, 0.8)
        + 8 * grain(rng, size, size, 2.5)
        + 9 * layered_noise(rng, size, size, 6, 7, 0.75)
    )
    stains = np.clip(layered_noise(rng, size, size, 7, 6, 0.65) - 1.1, 0.0, 1.0)
    chipped = np.clip(layered_noise(rng, size, size, 16, 6, 0.7) - 2.0, 0.0, 0.5) > 0.12
    field = field - 55 * stains - 50 * chipped
    for _ in range(9):
        _hairline(field, rng)
    return np.asarray(field)


def _hairline(field: NDArray[np.floating], rng: np.random.Generator) -> None:
    """A crack in the plaster."""
    size = len(field)
    steps = int(rng.integers(60, 260))
    heading = np.cumsum(rng.normal(0, 0.35, steps)) + rng.uniform(0, 2 * np.pi)
    path = rng.integers(0, size, 2) + 1.5 * np.cumsum(np.stack([np.sin(heading), np.cos(heading)], -1), axis=0)
    row, column = (path % size).astype(int).T
    field[row, column] -= 70
    field[(row + 1) % size, column] -= 40


def _stone(rng: np.random.Generator, size: int) -> NDArray[np.float64]:
    rows = int(rng.choice([14, 18]))
    row, column, edge = _courses(size, rows, 9)
    tone = rng.normal(0, 17, (rows, 9))
    field = (
        204 + tone[row, column] + 10 * grain(rng, size, size, 1.0) + 11 * layered_noise(rng, size, size, 12, 6, 0.75)
    )
    return np.asarray(np.where(edge < 1.8, field - 75, field))


def _boards(rng: np.random.Generator, size: int) -> NDArray[np.float64]:
    boards = 44
    y, x = np.mgrid[0:size, 0:size]
    height = y / (size / boards)
    tone = rng.normal(0, 6, boards)
    board = height.astype(int) % boards
    weather = np.repeat(layered_noise(rng, size, size // 8, 24, 5), 8, axis=1)[:, :size]
    joint = np.abs(x - rng.integers(0, size, boards)[board]) < 1.5
    field = 226 + tone[board] - 26 * (height % 1.0) + 5 * grain(rng, size, size, 0.8) + 9 * weather
    return np.asarray(np.where((height % 1.0 > 0.90) | joint, field - 85, field))


def paint_roof(rng: np.random.Generator, size: int = 768) -> NDArray[np.uint8]:
    """Rows of tiles or slates, tintable; tiles."""
    rows, columns = 30, 26
    row, column, edge = _courses(size, rows, columns)
    y = np.mgrid[0:size, 0:size][0] / (size / rows)
    tone = rng.normal(0, 20, (rows, columns))
    field = 200 + tone[row, column] - 45 * (y % 1.0) + 8 * grain(rng, size, size, 0.7)
    return opaque(np.where(edge < 1.6, field - 55, field), (1.0, 1.0, 1.0), TINTED)


ROOF_COLOURS = [(150, 84, 66), (92, 88, 90), (126, 76, 64), (110, 104, 100), (84, 70, 64)]


def paint_plain(rng: np.random.Generator, size: int = 128, tone: float = 225.0) -> NDArray[np.uint8]:
    """An evenly coloured tintable surface with a little grain; tiles."""
    return opaque(tone + 5 * grain(rng, size, size) + 5 * layered_noise(rng, size, size, 4, 4), (1.0, 1.0, 1.0), TINTED)


def paint_bark(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Bark; tiles."""
    ridges = np.repeat(layered_noise(rng, 32, 256, 24, 5), 8, axis=0)
    return opaque(104 + 20 * ridges + 9 * grain(rng, 256, 256, 0.8), (1.0, 0.88, 0.74))
