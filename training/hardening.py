"""What real cameras, suns and streets add to clean pictures, drawn at random and drawn wide.

Tone curves that crush blacks and burn skies, hard shadows of houses and trees, dapples, blur and sharpening, noise,
compression, texture over what is no instance, and things before the instances.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def hardened(
    image: NDArray[np.uint8], ids: NDArray[np.uint8], rng: np.random.Generator, hardness: float = 1.0
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The crop in another light, before another lens, with things in between.

    Args:
        hardness: 0 leaves the crop almost as it is, 1 spares little; half of the crops get away with less.
    """
    x = image.astype(np.float32) / 255
    ids = ids.copy()
    h = hardness * (0.3 if rng.random() < 0.5 else 1.0)
    if rng.random() < 0.25 * h:
        _texture_background(x, ids, rng)
    if rng.random() < 0.35 * h:
        _occlude(x, ids, rng)
    if rng.random() < 0.5 * h:
        x *= _shade(x.shape, rng)
    if rng.random() < 0.25 * h:
        x *= _dapple(x.shape, rng)
    if rng.random() < 0.45 * h:
        x *= _crowns(x.shape, rng)
    if rng.random() < 0.2 * h:
        x = x * rng.uniform(0.6, 1.0) + rng.uniform(0.0, 0.5) * _cloud(x.shape, rng, 5)
    x = _toned(np.clip(x, 0, 1), rng, h)
    x = _through_lens(x, rng, h)
    out = np.clip(255 * x + 0.5, 0, 255).astype(np.uint8)
    if rng.random() < 0.2 * h:
        tiles = int(rng.integers(2, 9))
        out = cv2.createCLAHE(float(rng.uniform(1, 4)), (tiles, tiles)).apply(out)
    if rng.random() < 0.2 * h:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 90))]
        out = cv2.imdecode(cv2.imencode(".jpg", out, quality)[1], cv2.IMREAD_GRAYSCALE)
    return np.asarray(out, np.uint8), ids


def _cloud(shape: tuple[int, ...], rng: np.random.Generator, cells: float) -> NDArray[np.float32]:
    """Smooth noise in 0..1 with about so many cells across the height."""
    rows = max(2, int(cells))
    columns = max(2, int(cells * shape[1] / shape[0]))
    coarse = rng.random((rows, columns), np.float32)
    return np.clip(cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC), 0, 1)


def _texture_background(x: NDArray[np.float32], ids: NDArray[np.uint8], rng: np.random.Generator) -> None:
    """Texture over what is no instance, so that it is not told by the simulator's surfaces."""
    cells = float(np.exp(rng.uniform(np.log(6), np.log(128))))
    texture = _cloud(x.shape, rng, cells) - 0.5
    if rng.random() < 0.4:
        texture = np.sign(texture) * 0.5
    texture *= _cloud(x.shape, rng, 4) * rng.uniform(0.1, 0.7)
    outside = ids == 0
    x[outside] = np.clip(x * (1 + texture) + 0.3 * texture, 0, 1)[outside]


def _occlude(x: NDArray[np.float32], ids: NDArray[np.uint8], rng: np.random.Generator) -> None:
    """Posts, boxes and bushes before everything."""
    height, width = x.shape
    for _ in range(int(rng.integers(1, 5))):
        mask = np.zeros(x.shape, np.uint8)
        x0, y0 = int(rng.integers(0, width)), int(rng.integers(0, height))
        kind = rng.random()
        if kind < 0.5:
            thick = int(np.exp(rng.uniform(np.log(2), np.log(22))))
            lean = int(rng.normal(0, 8))
            cv2.line(mask, (x0, int(y0 - rng.uniform(50, 300))), (x0 + lean, int(y0 + rng.uniform(20, 200))), 1, thick)
        elif kind < 0.8:
            w, h = int(rng.uniform(10, 90)), int(rng.uniform(10, 90))
            box = cv2.boxPoints(((x0, y0), (w, h), float(rng.normal(0, 6))))
            cv2.fillPoly(mask, [box.astype(np.int32)], 1)
        else:
            radius = int(rng.uniform(10, 50))
            cv2.circle(mask, (x0, y0), radius, 1, -1)
            mask &= (_cloud(x.shape, rng, height / rng.uniform(2, 8)) > 0.45).astype(np.uint8)
        covered = mask > 0
        texture = rng.random() * (0.6 + 0.8 * _cloud(x.shape, rng, float(rng.uniform(2, 100))))
        x[covered] = np.clip(texture, 0, 1)[covered]
        ids[covered] = 0


def _shade(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Hard shadows of houses in which little light is left, and patches of sun that burn out; factors of light."""
    light = np.ones(shape, np.float32)
    room = np.array([shape[1], shape[0]])
    for _ in range(int(rng.integers(1, 5))):
        corners = (rng.random((int(rng.integers(3, 6)), 2)) * 1.4 - 0.2) * room
        if rng.random() < 0.4:  # no larger than a car
            corners = rng.random(2) * room + rng.normal(0, 45, corners.shape)
        dark = rng.random() < 0.6
        factor = rng.uniform(0.05, 0.7) if dark else rng.uniform(1.4, 5.0)
        cv2.fillPoly(light, [cv2.convexHull(corners.astype(np.int32))], float(factor))
    return np.asarray(cv2.GaussianBlur(light, (0, 0), float(rng.uniform(0.5, 3))), np.float32)


def _dapple(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Light through leaves."""
    spots = (_cloud(shape, rng, float(rng.uniform(12, 60))) > rng.uniform(0.4, 0.65)).astype(np.float32)
    where = _cloud(shape, rng, 3) > 0.45
    spots[~where] = 1.0
    soft = cv2.GaussianBlur(spots, (0, 0), float(rng.uniform(0.6, 2.0)))
    dark = rng.uniform(0.2, 0.7)
    return np.asarray(dark + (1 - dark) * soft, np.float32)


def _crowns(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Shadows of trees over road, walls and cars: large, flat as seen from the car, and frayed at the edge."""
    flat = float(np.exp(rng.uniform(0.0, np.log(8.0))))
    room = (shape[0], max(2, int(shape[1] / flat)))
    cells = float(rng.uniform(1.5, 6.0))
    fade = float(rng.uniform(0.5, 0.8))
    cover = np.zeros(room, np.float32)
    share = 1.0
    while cells < room[0] / 2:
        cover += share * _cloud(room, rng, cells)
        cells, share = 2.2 * cells, fade * share
    cover = cv2.resize(cover, shape[::-1], interpolation=cv2.INTER_LINEAR)
    dark = float(np.exp(rng.uniform(np.log(0.08), np.log(0.6))))
    lit = (cover > np.quantile(cover[::4, ::4], rng.uniform(0.2, 0.8))).astype(np.float32)
    soft = cv2.GaussianBlur(lit, (0, 0), float(rng.uniform(0.5, 2.0)))
    return np.asarray(dark + (1 - dark) * soft, np.float32)


def _toned(x: NDArray[np.float32], rng: np.random.Generator, h: float) -> NDArray[np.float32]:
    """Another exposure and film curve: most pictures use their range, some burn the sky or drown the shadows."""
    low, high = np.percentile(x[::4, ::4], [2.0, 97.0])
    black, white = 0.05 + h * rng.uniform(-0.13, 0.13), 0.95 + h * rng.uniform(-0.5, 0.55)
    if rng.random() < 0.2 + 0.6 * h:
        x = np.clip((x - low) / max(high - low, 0.05) * (white - black) + black, 0, 1)
    x = np.power(x, np.float32(np.exp(rng.normal(0.0, 0.08 + 0.3 * h))))
    if rng.random() < 0.3 * h:
        knots = np.sort(rng.random(5))
        x = np.interp(x, np.linspace(0, 1, 5), 0.5 * knots + 0.5 * np.linspace(0, 1, 5)).astype(np.float32)
    mean = float(x.mean())
    if mean < 0.15:  # so dark that little could be seen
        x = np.power(x, np.float32(max(np.log(rng.uniform(0.15, 0.3)) / np.log(max(mean, 0.01)), 0.35)))
    if rng.random() < 0.02 * h:
        x = 1 - x
    return np.clip(x, 0, 1).astype(np.float32)


def _through_lens(x: NDArray[np.float32], rng: np.random.Generator, h: float) -> NDArray[np.float32]:
    kind = rng.random() / max(h, 0.1)
    if kind < 0.25:
        x = cv2.GaussianBlur(x, (0, 0), float(rng.uniform(0.3, 1.3)))
    elif kind < 0.35:
        length = int(rng.integers(2, 7))
        kernel = np.zeros((length, length), np.float32)
        cv2.line(kernel, (0, int(rng.integers(0, length))), (length - 1, int(rng.integers(0, length))), 1.0)
        x = cv2.filter2D(x, -1, kernel / kernel.sum())
    elif kind < 0.7:
        x = x + float(rng.uniform(0.2, 1.5)) * (x - cv2.GaussianBlur(x, (0, 0), float(rng.uniform(0.6, 1.5))))
    if rng.random() < 0.2 + 0.4 * h:
        sigma = float(np.exp(rng.uniform(np.log(0.004), np.log(0.01 + 0.04 * h))))
        x = x + rng.standard_normal(x.shape, np.float32) * np.float32(sigma)
    return np.asarray(x, np.float32)
