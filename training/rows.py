"""Vehicles of one crop put before and behind those of another: dense rows for nothing (copy and paste).

After Ghiasi et al., "Simple Copy-Paste is a Strong Data Augmentation Method for Instance Segmentation" (CVPR 2021);
here what stands lower in the picture is nearer, so that a pasted vehicle hides some and is hidden by others.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from training.classes import CLASS_OF_LABEL

_MIN_CELLS = 500
"""Pixels of a crop from which a vehicle is worth pasting."""
_WHOLE = 0.55
"""Share of its box that a vehicle fills which little hides."""


def with_rows(
    image: NDArray[np.uint8],
    ids: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    other: tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]],
    rng: np.random.Generator,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]:
    """The crop (H, W) with vehicles of another crop (image, ids, labels); its new ids and labels (256,)."""
    vehicles = _vehicles(other[1], other[2])
    if not vehicles:
        return image, ids, labels
    image, ids, labels = image.copy(), ids.copy(), labels.copy()
    width = ids.shape[1]
    bottom = _bottoms(ids)
    hosts = _vehicles(ids, labels)
    free = [i for i in range(1, 256) if not (ids == i).any()] if len(hosts) else list(range(255, 1, -1))
    for _ in range(int(rng.integers(1, 4))):
        source = vehicles[int(rng.integers(0, len(vehicles)))]
        x0, y0, x1, y1 = source[1]
        cut, shape = other[0][y0:y1, x0:x1], (other[1][y0:y1, x0:x1] == source[0]).astype(np.uint8)
        if rng.random() < 0.5:
            cut, shape = cut[:, ::-1], shape[:, ::-1]
        w, h = x1 - x0, y1 - y0
        if hosts and rng.random() < 0.75:  # beside another, partly before or behind it
            hx0, hy0, hx1, hy1 = hosts[int(rng.integers(0, len(hosts)))][1]
            scale = float(np.clip((hy1 - hy0) / h * np.exp(rng.normal(0, 0.12)), 0.4, 2.0))
            w, h = max(int(w * scale), 8), max(int(h * scale), 8)
            step = rng.choice([-1, 1]) * rng.uniform(0.2, 1.0) * 0.5 * (w + hx1 - hx0)
            left, foot = (hx0 + hx1 - w) / 2 + step, hy1 + rng.normal(0, 0.12) * h
        else:
            scale = float(np.exp(rng.normal(0, 0.15)))
            w, h = max(int(w * scale), 8), max(int(h * scale), 8)
            left, step, foot = rng.uniform(-0.3 * w, width - 0.7 * w), w * rng.uniform(0.3, 1.0), y1 + rng.normal(0, 6)
        cut = cv2.resize(cut, (w, h), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        shape = cv2.resize(shape, (w, h), interpolation=cv2.INTER_LINEAR)
        slope = rng.normal(0, 0.06)
        for number in range(int(rng.choice([1, 1, 2, 4]))):
            if not free:
                break
            new = free.pop()
            at = int(left + number * step), int(foot - h + slope * number * abs(step))
            tone = np.clip(cut.astype(np.float32) * rng.uniform(0.6, 1.5) + rng.uniform(-25, 25), 0, 255)
            if _paste(image, ids, bottom, tone, shape, at, new, rng):
                labels[new] = other[2][source[0]]
    return image, ids, labels


def _paste(
    image: NDArray[np.uint8],
    ids: NDArray[np.uint8],
    bottom: NDArray[np.int64],
    cut: NDArray[np.float32],
    shape: NDArray[np.uint8],
    at: tuple[int, int],
    new: int,
    rng: np.random.Generator,
) -> bool:
    height, width = ids.shape
    h, w = shape.shape
    x0, y0, x1, y1 = max(at[0], 0), max(at[1], 0), min(at[0] + w, width), min(at[1] + h, height)
    if x1 - x0 < 6 or y1 - y0 < 6:
        return False
    window, part = np.s_[y0:y1, x0:x1], np.s_[y0 - at[1] : y1 - at[1], x0 - at[0] : x1 - at[0]]
    foot = at[1] + h
    before = bottom[ids[window]] <= foot
    alpha = (shape[part] > 0) & before
    soft = cv2.GaussianBlur(alpha.astype(np.float32), (0, 0), float(rng.uniform(0.3, 0.7)))
    image[window] = (image[window] * (1 - soft) + cut[part] * soft).astype(np.uint8)
    ids[window][alpha] = new
    bottom[new] = foot
    return bool(alpha.any())


def _bottoms(ids: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Lowest row (256,) of every instance, -1 for the background."""
    bottom = np.full(256, -1, np.int64)
    ys, xs = np.nonzero(ids)
    np.maximum.at(bottom, ids[ys, xs], ys + 1)
    return bottom


def _vehicles(ids: NDArray[np.uint8], labels: NDArray[np.uint8]) -> list[tuple[int, tuple[int, int, int, int]]]:
    """Large vehicles that little hides, with their boxes."""
    found = []
    area = np.bincount(ids.ravel(), minlength=256)
    for number in np.flatnonzero((area >= _MIN_CELLS) & (CLASS_OF_LABEL[labels] == 1)):
        mask = ids == number
        columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
        x0, y0, x1, y1 = int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
        inside = x0 > 0 and x1 < ids.shape[1] and y1 < ids.shape[0]
        if inside and area[number] >= _WHOLE * (x1 - x0) * (y1 - y0):
            found.append((int(number), (x0, y0, x1, y1)))
    return found
