"""Pieces of rendered pictures at the network's scale, and what the network should say of them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from training.classes import CLASS_OF_LABEL

CROP_H, CROP_W = 224, 512
IGNORED = 255
"""Class of pixels about which nothing is demanded."""

_SCALES, _USUAL_SCALES = (0.45, 1.1), (0.72, 0.98)
"""Network pixels per image pixel; the car runs the network between the latter."""
_MIN_AREA = 14
"""Pixels of the output from which an instance counts; what is smaller is neither demanded nor forbidden."""
_FOCUS = 0.7
"""Share of the crops that are centred on an instance."""
_LARGE = 900
"""Pixels of the picture from which an instance is looked at more often."""
_LINKED_AREA, _OTHERS = 100, 0.4
"""Pixels of the output below which links within and between instances weigh less; how much those of no vehicles do."""
_CROWDED = 2.0
"""How much more the votes of an instance weigh the more its box overlaps another's: those are told apart by little."""


def normalised(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Grey levels as the network takes them."""
    return image.astype(np.float32) / np.float32(127.5) - np.float32(1.0)


def crop(
    grey: NDArray[np.uint8], ids: NDArray[np.uint8], labels: NDArray[np.uint8], rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A piece (CROP_H, CROP_W) at a random scale and aspect, perhaps mirrored; ids (CROP_H, CROP_W)."""
    scale = float(np.exp(rng.uniform(*np.log(_SCALES)))) if rng.random() < 0.6 else float(rng.uniform(*_USUAL_SCALES))
    sx, sy = scale * float(np.exp(rng.normal(0, 0.06))), scale
    height, width = grey.shape
    h, w = min(height, int(CROP_H / sy)), min(width, int(CROP_W / sx))
    middle = rng.random(2) * [width, height]
    if rng.random() < _FOCUS and ids.any():
        present = np.unique(ids[::6, ::6])
        present = present[present > 0]
        if len(present):
            area = 9 * np.bincount(ids[::3, ::3].ravel(), minlength=256)[present]
            interest = np.where(CLASS_OF_LABEL[labels[present]] == 1, 4.0, 1.0) * np.where(area > _LARGE, 3.0, 1.0)
            ys, xs = np.nonzero(ids == rng.choice(present, p=interest / interest.sum()))
            middle = np.array([xs.mean(), ys.mean()]) + rng.normal(0, 1, 2) * [0.25 * w, 0.2 * h]
    x0 = int(np.clip(middle[0] - w / 2, 0, width - w))
    y0 = int(np.clip(middle[1] - h / 2, 0, height - h))
    piece, owner = grey[y0 : y0 + h, x0 : x0 + w], ids[y0 : y0 + h, x0 : x0 + w]
    size = (min(CROP_W, round(w * sx)), min(CROP_H, round(h * sy)))
    shrink = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    piece = cv2.resize(piece, size, interpolation=shrink)
    owner = cv2.resize(owner, size, interpolation=cv2.INTER_NEAREST)
    image = np.full((CROP_H, CROP_W), 114, np.uint8)
    out_ids = np.zeros((CROP_H, CROP_W), np.uint8)
    top, left = (CROP_H - size[1]) // 2, (CROP_W - size[0]) // 2
    image[top : top + size[1], left : left + size[0]] = piece
    out_ids[top : top + size[1], left : left + size[0]] = owner
    if rng.random() < 0.5:
        image, out_ids = image[:, ::-1], out_ids[:, ::-1]
    return np.ascontiguousarray(image), np.ascontiguousarray(out_ids)


def targets(
    ids: NDArray[np.uint8], labels: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    """What the network should say of a crop.

    Returns:
        classes: (h, w) uint8 at half the size, 0 background, `IGNORED` where nothing is demanded.
        boxes: (h, w, 4) float32, left, top, right, bottom of the visible part of the pixel's instance in crop pixels.
        weight: (h, w) float32, of the pixel's vote: the same in sum for instances of any size, up to a root, and more
            for instances whose boxes overlap.
        owner: (h, w) uint8, number of the cell's instance.
        bond: (h, w) float32, weight of the cell's links, 0 where nothing is demanded.
    """
    small = ids[1::2, 1::2]
    classes = CLASS_OF_LABEL[labels[small]]
    area = np.bincount(small.ravel(), minlength=256)
    table = np.zeros((256, 4), np.float32)
    left, right = np.full(256, CROP_W), np.zeros(256)
    top, bottom = np.full(256, CROP_H), np.zeros(256)
    ys, xs = np.nonzero(small)
    owner = small[ys, xs]
    np.minimum.at(left, owner, xs), np.maximum.at(right, owner, xs)
    np.minimum.at(top, owner, ys), np.maximum.at(bottom, owner, ys)
    table[:] = 2 * np.stack([left, top, right + 1, bottom + 1], 1)
    weight = np.where(area >= _MIN_AREA, np.sqrt(250.0 / np.maximum(area, 1)), 0.0).clip(0, 4)
    weight[0] = 0
    weight *= 1 + _CROWDED * _crowding(table, weight > 0)
    too_small = (area < _MIN_AREA) & (np.arange(256) > 0)
    classes = np.where(too_small[small], np.uint8(IGNORED), classes)
    votes = weight.astype(np.float32)[small] * (classes > 0) * (classes != IGNORED)
    bond = weight * np.clip(area / _LINKED_AREA, 0.2, 1.0) * np.where(CLASS_OF_LABEL[labels] == 1, 1.0, _OTHERS)
    bonds = bond.astype(np.float32)[small] * (classes > 0) * (classes != IGNORED)
    return classes.astype(np.uint8), table[small], votes.astype(np.float32), small, bonds.astype(np.float32)


def _crowding(boxes: NDArray[np.float32], counts: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Largest overlap (256,) of each box (256, 4) with another one, of those that count."""
    most = np.zeros(len(boxes), np.float32)
    own = np.flatnonzero(counts)
    if len(own) > 1:
        a, b = boxes[own][:, None], boxes[own][None]
        sides = (np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2])).clip(min=0)
        area = (boxes[own, 2:] - boxes[own, :2]).prod(axis=1)
        both = sides.prod(axis=2)
        overlap = both / (area[:, None] + area[None] - both)
        np.fill_diagonal(overlap, 0.0)
        most[own] = overlap.max(axis=1)
    return most
