"""Windows, doors and shop fronts, each kind in one atlas."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.surfaces.finish import GLASS, MATTE, TINTED
from autowaze.simulator.surfaces.noise import grain

WINDOW_CELLS = 28
DOOR_CELLS = 4
SHOP_CELLS = 6
_CELL = 256
_WINDOW_ROWS = (WINDOW_CELLS + DOOR_CELLS) // 4

_SYLLABLES = [
    "BA",
    "CO",
    "DEL",
    "FI",
    "GRO",
    "HAN",
    "JO",
    "KA",
    "LU",
    "MA",
    "NOR",
    "PE",
    "RO",
    "SA",
    "TI",
    "VER",
    "WIL",
    "ZO",
]
_TRADES = [
    "CAFE",
    "BAKERY",
    "OPTIK",
    "BOOKS",
    "FLORIST",
    "PIZZA",
    "BANK",
    "SHOES",
    "PHARMA",
    "HAIR",
    "MARKET",
    "DELI",
    "BIKES",
    "PRINT",
]


def window_cell(index: int) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of a window, or from `WINDOW_CELLS` on of a door, in the atlas, 0..1."""
    row, column = divmod(index, 4)
    x, y = 2.0 / (4 * _CELL), 2.0 / (_WINDOW_ROWS * _CELL)
    return column / 4 + x, row / _WINDOW_ROWS + y, (column + 1) / 4 - x, (row + 1) / _WINDOW_ROWS - y


def shop_cell(index: int) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of a shop front in its atlas, 0..1."""
    inset = 0.002
    return inset, index / SHOP_CELLS + inset, 1 - inset, (index + 1) / SHOP_CELLS - inset


def paint_windows(rng: np.random.Generator, lit: float = 0.0) -> NDArray[np.uint8]:
    """Atlas (2048, 1024, 4) of windows, a row of four per frame, and 4 doors; `lit` is the share of lit rooms."""
    atlas = np.zeros((_WINDOW_ROWS * _CELL, 4 * _CELL, 4), np.uint8)
    frames = [
        (232, 230, 224),
        (64, 60, 56),
        (120, 84, 58),
        (206, 204, 198),
        (238, 238, 236),
        (90, 40, 36),
        (222, 214, 196),
    ]
    for index in range(WINDOW_CELLS + DOOR_CELLS):
        row, column = divmod(index, 4)
        tile = atlas[row * _CELL : (row + 1) * _CELL, column * _CELL : (column + 1) * _CELL]
        if index < WINDOW_CELLS:
            _window(tile, frames[row], rng, rng.random() < lit)
        else:
            _door(tile, rng)
    return atlas


def _panes(
    tile: NDArray[np.uint8], left: int, top: int, right: int, bottom: int, rng: np.random.Generator, lit: bool
) -> None:
    """A pane with the room behind it."""
    height = max(bottom - top, 1)
    room = (
        np.array([196, 158, 96]) * rng.uniform(0.75, 1.1) * np.linspace(1.1, 0.7, height)[:, None, None]
        if lit
        else np.array([34, 38, 42]) * rng.uniform(0.6, 1.5) * np.linspace(1.5, 0.7, height)[:, None, None]
    )
    tile[top:bottom, left:right, :3] = np.clip(room, 0, 255)
    tile[top:bottom, left:right, 3] = MATTE if lit else GLASS
    style = rng.random()
    cloth = np.array([205, 200, 188]) * rng.uniform(0.55, 1.0)
    if style < 0.35:
        wide = int((right - left) * rng.uniform(0.12, 0.32))
        folds = 1 - 0.16 * (np.sin(np.arange(wide) * 0.7) > 0)
        for start in (left, right - wide):
            tile[top:bottom, start : start + wide, :3] = np.clip(cloth * folds[None, :, None], 0, 255)
    elif style < 0.62:
        drop = int(height * rng.uniform(0.12, 0.75))
        slats = 1 - 0.22 * (np.arange(drop) % 9 < 2)
        tile[top : top + drop, left:right, :3] = np.clip(cloth * slats[:, None, None], 0, 255)
    elif style < 0.8:
        pot = int(rng.integers(left, max(left + 1, right - 20)))
        cv2.circle(tile, (pot + 10, bottom - 22), 16, (52, 72, 40, GLASS), -1)
        cv2.rectangle(tile, (pot, bottom - 14), (pot + 20, bottom - 1), (130, 88, 66, GLASS), -1)


def _window(tile: NDArray[np.uint8], frame: tuple[int, int, int], rng: np.random.Generator, lit: bool) -> None:
    tile[..., :3], tile[..., 3] = frame, MATTE
    rim = 14
    _panes(tile, rim, rim, _CELL - rim, _CELL - rim, rng, lit)
    bar = (*frame, MATTE)
    if rng.random() < 0.8:
        cv2.rectangle(tile, (_CELL // 2 - 7, 0), (_CELL // 2 + 7, _CELL), bar, -1)
    if rng.random() < 0.5:
        y = int(_CELL * rng.choice([0.3, 0.5]))
        cv2.rectangle(tile, (0, y - 6), (_CELL, y + 6), bar, -1)
    cv2.rectangle(tile, (rim, rim), (_CELL - rim, _CELL - rim), (*(int(c * 0.55) for c in frame), MATTE), 3)


def _door(tile: NDArray[np.uint8], rng: np.random.Generator) -> None:
    colour = rng.integers(28, 120, 3)
    tile[..., :3], tile[..., 3] = colour, MATTE
    dark = (*(int(c * 0.6) for c in colour), MATTE)
    for y0, y1 in ((0.10, 0.45), (0.53, 0.92)):
        for x0, x1 in ((0.14, 0.45), (0.55, 0.86)):
            cv2.rectangle(tile, (int(x0 * _CELL), int(y0 * _CELL)), (int(x1 * _CELL), int(y1 * _CELL)), dark, 5)
    if rng.random() < 0.6:
        _panes(tile, int(0.16 * _CELL), int(0.12 * _CELL), int(0.84 * _CELL), int(0.42 * _CELL), rng, False)
    cv2.circle(tile, (int(0.90 * _CELL), int(0.55 * _CELL)), 8, (180, 170, 130, MATTE), -1)


def paint_shops(rng: np.random.Generator, lit: float = 0.0) -> NDArray[np.uint8]:
    """Atlas (1536, 1024, 4) of shop fronts: sign, glass, door, goods."""
    atlas = np.zeros((SHOP_CELLS * _CELL, 4 * _CELL, 4), np.uint8)
    for index in range(SHOP_CELLS):
        _shop(atlas[index * _CELL : (index + 1) * _CELL], rng, rng.random() < lit)
    return atlas


def _shop(tile: NDArray[np.uint8], rng: np.random.Generator, lit: bool) -> None:
    height, width = tile.shape[:2]
    frame = tuple(int(v) for v in rng.integers(30, 110, 3))
    tile[..., :3], tile[..., 3] = frame, MATTE
    sign = int(0.24 * height)
    board = tuple(int(v) for v in rng.integers(20, 210, 3))
    cv2.rectangle(tile, (0, 0), (width, sign), (*board, MATTE), -1)
    ink = (245, 244, 238) if sum(board) < 390 else (28, 26, 30)
    name = "".join(rng.choice(_SYLLABLES, int(rng.integers(2, 4)))) + " " + str(rng.choice(_TRADES))
    font = int(rng.choice([cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_TRIPLEX, cv2.FONT_HERSHEY_SIMPLEX]))
    cv2.putText(
        tile, name, (int(rng.uniform(0.05, 0.3) * width), int(sign * 0.76)), font, 1.5, (*ink, MATTE), 4, cv2.LINE_AA
    )
    bays = int(rng.integers(3, 6))
    door = int(rng.integers(0, bays))
    for bay in range(bays):
        x0, x1 = int((bay + 0.06) * width / bays), int((bay + 0.94) * width / bays)
        top, bottom = sign + 14, height - (4 if bay == door else 34)
        glass = np.linspace(1.5, 0.8, bottom - top)[:, None, None] * np.array([40, 44, 48]) * rng.uniform(0.6, 1.3)
        if lit:
            glass = np.linspace(1.1, 0.8, bottom - top)[:, None, None] * np.array([214, 188, 140])
        tile[top:bottom, x0:x1, :3] = np.clip(glass, 0, 255)
        tile[top:bottom, x0:x1, 3] = MATTE if lit else GLASS
        for _ in range(0 if bay == door else int(rng.integers(2, 9))):
            x, h, w = int(rng.integers(x0, x1)), int(rng.integers(12, 70)), int(rng.integers(8, 34))
            goods = tuple(int(v) for v in rng.integers(40, 190, 3))
            cv2.rectangle(tile, (x, bottom - h), (min(x + w, x1), bottom), (*goods, GLASS), -1)
        if rng.random() < 0.3:
            poster = tuple(int(v) for v in rng.integers(60, 230, 3))
            cv2.rectangle(tile, (x0 + 10, top + 20), (x0 + 60, top + 90), (*poster, MATTE), -1)
    tile[..., :3] = np.clip(tile[..., :3] + 3 * grain(rng, height, width)[..., None], 0, 255)


def paint_awning(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Striped cloth."""
    stripes = (np.arange(256) // 32) % 2 == 0
    colour = rng.integers(60, 200, 3)
    tile = np.where(stripes[None, :, None], np.array([228, 224, 214]), colour) * np.ones((64, 1, 1))
    return np.concatenate([tile, np.full((64, 256, 1), float(MATTE))], -1).astype(np.uint8)


def paint_garage(rng: np.random.Generator) -> NDArray[np.uint8]:
    """A ribbed garage door, tintable."""
    rows = 220 - 40 * ((np.arange(256) % 42) < 5)
    tile = rows[:, None, None] + 3 * grain(rng, 256, 256)[..., None] * np.ones(3)
    return np.concatenate([np.clip(tile, 0, 255), np.full((256, 256, 1), float(TINTED))], -1).astype(np.uint8)
