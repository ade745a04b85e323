"""Asphalt, paving, kerbstones, grass, and what lies painted or worn on the road."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.surfaces.finish import MATTE
from autowaze.simulator.surfaces.noise import grain, layered_noise

ASPHALT_M, PAVING_M, GRASS_M = 14.0, 4.0, 6.0
"""Metres that one repeat of the texture covers."""


def opaque(
    grey: NDArray[np.floating], colour: tuple[float, float, float] = (1.0, 0.99, 0.97), alpha: int = MATTE
) -> NDArray[np.uint8]:
    """RGBA texture of a brightness field 0..255 in one hue."""
    rgb = np.clip(np.asarray(grey)[..., None] * np.array(colour), 0, 255)
    return np.concatenate([rgb, np.full((*rgb.shape[:2], 1), float(alpha))], -1).astype(np.uint8)


def paint_asphalt(rng: np.random.Generator, size: int = 1536) -> NDArray[np.uint8]:
    """Worn asphalt with stones, stains and cracks; tiles."""
    tone = rng.uniform(78, 104)
    field = tone + 8 * layered_noise(rng, size, size, 3, 6, 0.65)
    field += 9.0 * grain(rng, size, size) + 9.0 * grain(rng, size, size, 1.4)
    field += 7.0 * grain(rng, size, size, 3.5) + 5.0 * grain(rng, size, size, 8.0)
    stains = np.zeros((size, size), np.float32)
    for _ in range(30):
        centre, axes = rng.integers(0, size, 2), rng.uniform(8, 60, 2)
        cv2.ellipse(
            stains, _pixel(centre), _pixel(axes), float(rng.uniform(0, 180)), 0, 360, float(rng.uniform(-16, 9)), -1
        )
    field += cv2.GaussianBlur(stains, (0, 0), 5)
    for blur_px, threshold, tone_change in ((0.8, 2.6, 40), (2.2, 3.0, 45), (2.8, 3.0, -38)):
        field[grain(rng, size, size, blur_px) > threshold] += tone_change
    return opaque(field, (1.0, 0.99, 0.965))


def paint_paving(rng: np.random.Generator, size: int = 1024) -> NDArray[np.uint8]:
    """Paving slabs or small setts; tiles."""
    columns = int(rng.choice([8, 10, 16]))
    rows = columns * int(rng.choice([1, 2]))
    w, h = size / columns, size / rows
    y, x = np.mgrid[0:size, 0:size]
    row = (y / h).astype(int)
    shifted = (x + (row % 2) * w / 2) % size
    column = (shifted / w).astype(int)
    tones = rng.normal(0, 13, (rows, columns))
    field = rng.uniform(112, 150) + tones[row % rows, column % columns]
    field += 8 * layered_noise(rng, size, size, 6, 7, 0.7) + 8 * grain(rng, size, size, 0.7)
    field -= 45 * (layered_noise(rng, size, size, 12, 5) > 2.3)
    joint = np.minimum(np.minimum(y % h, h - y % h) / 2.0, np.minimum(shifted % w, w - shifted % w) / 2.0)
    field -= 42 * np.clip(1.2 - joint, 0, 1)
    return opaque(field, (1.0, rng.uniform(0.93, 0.99), rng.uniform(0.86, 0.97)))


def paint_kerb(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Kerbstones one metre long; tiles along."""
    field = 128 + 13 * grain(rng, 64, 512, 0.7) + 11 * layered_noise(rng, 64, 512, 4, 5)
    field[:, :3] -= 60
    field[:, 256:259] -= 60
    field[-6:] -= 35
    return opaque(field, (1.0, 0.975, 0.92))


def paint_grass(rng: np.random.Generator, size: int = 768) -> NDArray[np.uint8]:
    """Mown grass with bare spots; tiles."""
    field = 1.0 + 0.22 * layered_noise(rng, size, size, 4, 7, 0.75) + 0.16 * grain(rng, size, size, 0.7)
    green = np.array([78, 96, 46]) * field[..., None]
    bare = np.clip(layered_noise(rng, size, size, 5, 5) - 1.3, 0, 1)[..., None]
    rgb = green * (1 - bare) + np.array([116, 100, 76]) * bare
    return np.concatenate([np.clip(rgb, 0, 255), np.full((size, size, 1), float(MATTE))], -1).astype(np.uint8)


def paint_marking(rng: np.random.Generator, size: int = 512) -> NDArray[np.uint8]:
    """Road paint, worn; RGBA with coverage; tiles."""
    wear = layered_noise(rng, size, size, 8, 7, 0.78) + 0.5 * grain(rng, size, size, 0.8)
    coverage = np.clip(0.86 + 0.22 * wear, 0.15, 0.97)
    tone = np.clip(205 + 7 * grain(rng, size, size) + 6 * wear, 0, 255)
    return np.stack([tone, tone * 0.99, tone * 0.96, 255 * coverage], -1).astype(np.uint8)


def paint_blemishes(rng: np.random.Generator, size: int = 256) -> NDArray[np.uint8]:
    """Atlas of 4 x 4 things that lie on a road (cracks, tar, patches, manholes, oil, leaves); alpha is coverage."""
    atlas = np.zeros((4 * size, 4 * size, 4), np.uint8)
    painters = [_crack] * 5 + [_tar] * 2 + [_patch] * 3 + [_manhole] * 2 + [_oil] * 2 + [_litter] * 2
    for index, painter in enumerate(painters):
        row, column = divmod(index, 4)
        atlas[row * size : (row + 1) * size, column * size : (column + 1) * size] = painter(rng, size)
    return atlas


def blemish_cell(index: int) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of a blemish in its atlas, 0..1."""
    row, column = divmod(index, 4)
    return column / 4 + 0.004, row / 4 + 0.004, (column + 1) / 4 - 0.004, (row + 1) / 4 - 0.004


CRACKS, TAR, PATCHES, MANHOLES, OIL, LITTER = (
    range(5),
    range(5, 7),
    range(7, 10),
    range(10, 12),
    range(12, 14),
    range(14, 16),
)
"""Cells of the atlas of blemishes."""


def _pixel(point: NDArray[np.generic]) -> tuple[int, int]:
    return int(point[0]), int(point[1])


def _blank(size: int, colour: tuple[int, int, int]) -> NDArray[np.uint8]:
    tile = np.zeros((size, size, 4), np.uint8)
    tile[..., :3] = colour
    return tile


def _walk(rng: np.random.Generator, size: int, steps: int, wander: float) -> NDArray[np.int32]:
    heading = np.cumsum(rng.normal(0, wander, steps)) + rng.uniform(-0.3, 0.3)
    path = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], -1), axis=0)
    path = (path - path.min(0)) / max(float(np.ptp(path, axis=0).max()), 1e-6)
    return np.asarray(12 + path * (size - 24), np.int32)


def _crack(rng: np.random.Generator, size: int) -> NDArray[np.uint8]:
    coverage = np.zeros((size, size), np.uint8)
    for _ in range(int(rng.integers(1, 4))):
        path = _walk(rng, size, 40, 0.45)
        cv2.polylines(coverage, [path], False, int(rng.integers(150, 235)), int(rng.integers(1, 4)), cv2.LINE_AA)
    tile = _blank(size, (30, 29, 28))
    tile[..., 3] = coverage
    return tile


def _tar(rng: np.random.Generator, size: int) -> NDArray[np.uint8]:
    tile = _blank(size, (26, 26, 27))
    coverage = np.zeros((size, size), np.uint8)
    cv2.polylines(coverage, [_walk(rng, size, 30, 0.25)], False, 225, int(rng.integers(7, 12)), cv2.LINE_AA)
    tile[..., 3] = coverage
    return tile


def _patch(rng: np.random.Generator, size: int) -> NDArray[np.uint8]:
    tone = rng.uniform(48, 74) + 9 * grain(rng, size, size) + 5 * grain(rng, size, size, 2)
    tile = np.repeat(np.clip(tone, 0, 255)[..., None], 4, axis=2).astype(np.uint8)
    coverage = np.zeros((size, size), np.uint8)
    margin = int(size * 0.06)
    corners = np.array(
        [(margin, margin), (size - margin, margin), (size - margin, size - margin), (margin, size - margin)]
    )
    cv2.fillPoly(coverage, [(corners + rng.integers(-6, 7, (4, 2))).astype(np.int32)], 235)
    tile[..., 3] = cv2.GaussianBlur(coverage, (0, 0), 1.2)
    cv2.polylines(tile, [corners.astype(np.int32)], True, (24, 24, 25, 220), 4, cv2.LINE_AA)
    return tile


def _manhole(rng: np.random.Generator, size: int) -> NDArray[np.uint8]:
    tile = _blank(size, (70, 68, 66))
    middle, radius = (size // 2, size // 2), int(size * 0.42)
    cv2.circle(tile, middle, radius, (52, 50, 48, 245), -1, cv2.LINE_AA)
    for step in range(-radius, radius, 18):
        cv2.line(
            tile, (middle[0] + step, middle[1] - radius), (middle[0] + step, middle[1] + radius), (78, 76, 73, 245), 6
        )
        cv2.line(
            tile, (middle[0] - radius, middle[1] + step), (middle[0] + radius, middle[1] + step), (42, 41, 40, 245), 4
        )
    outside = np.hypot(*(np.mgrid[0:size, 0:size] - size / 2)) > radius
    tile[outside, 3] = 0
    cv2.circle(tile, middle, radius, (96, 93, 90, 245), 7, cv2.LINE_AA)
    return tile


def _oil(rng: np.random.Generator, size: int) -> NDArray[np.uint8]:
    blob = layered_noise(rng, size, size, 4, 5)
    distance = np.hypot(*(np.mgrid[0:size, 0:size] - size / 2)) / (size / 2)
    tile = _blank(size, (28, 27, 27))
    tile[..., 3] = (150 * np.clip(1.1 - 1.6 * distance + 0.25 * blob, 0, 1)).astype(np.uint8)
    return tile


def _litter(rng: np.random.Generator, size: int) -> NDArray[np.uint8]:
    tile = _blank(size, (110, 84, 40))
    for _ in range(int(rng.integers(12, 40))):
        colour = [int(v) for v in np.array([120, 88, 42]) * rng.uniform(0.5, 1.4)]
        at = _pixel(rng.normal(size / 2, size / 6, 2))
        cv2.ellipse(
            tile,
            at,
            (int(rng.integers(4, 8)), int(rng.integers(2, 5))),
            float(rng.uniform(0, 180)),
            0,
            360,
            (*colour, 240),
            -1,
        )
    return tile


def paint_contact_shadow(size: int = 128) -> NDArray[np.uint8]:
    """Soft dark rectangle: the light that a car keeps from the ground under it."""
    axis = np.abs(np.linspace(-1, 1, size))
    edge = np.clip((1.0 - axis) / 0.36, 0, 1)
    soft = edge * edge * (3 - 2 * edge)
    tile = np.zeros((size, size, 4), np.uint8)
    tile[..., 3] = (200 * np.outer(soft, soft)).astype(np.uint8)
    return tile
