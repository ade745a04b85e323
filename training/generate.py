"""Rendering the training pictures: per street one file of grey pictures, ids and labels."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import AutowazeError
from training.scenery import Setting
from training.streets import random_description
from training.wardrobe import Wardrobe

_JPEG_QUALITY = 95


def generate(folder: Path, first: int, streets: int, pictures: int) -> None:
    """Render `pictures` of each of the streets numbered from `first`; streets that lie there already are skipped.

    A street becomes street-NUMBER.npz: `grey` and `ids`, JPEG and PNG files as bytes one after the other with their
    ends in `grey_ends` and `ids_ends`, and `labels` (pictures, 256) uint8, the class of every id.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wardrobe = Wardrobe(np.random.default_rng([first, 1]))
    for number in range(first, first + streets):
        path = folder / f"street-{number:05d}.npz"
        if path.is_file():
            continue
        start = time.monotonic()
        rng = np.random.default_rng([number, 2])
        try:
            setting = Setting(random_description(number, rng), wardrobe, rng)
        except AutowazeError as error:  # rows of bays that do not fit that street
            print(f"street {number}: left out: {error}", flush=True)
            continue
        _write(path, [setting.picture() for _ in range(pictures)], rng)
        setting.close()
        print(f"street {number}: {time.monotonic() - start:.1f} s", flush=True)


def _write(
    path: Path, pictures: list[tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]], rng: np.random.Generator
) -> None:
    greys = [_encoded(".jpg", grey_mix(p, rng), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]) for p, _, _ in pictures]
    ids = [_encoded(".png", i, [cv2.IMWRITE_PNG_COMPRESSION, 3]) for _, i, _ in pictures]
    labels = np.zeros((len(pictures), 256), np.uint8)
    for row, (_, _, of_ids) in zip(labels, pictures, strict=True):
        row[: len(of_ids)] = of_ids
    partial = path.with_suffix(".part")
    with partial.open("wb") as file:
        np.savez(
            file,
            grey=np.concatenate(greys),
            grey_ends=np.cumsum([len(g) for g in greys]),
            ids=np.concatenate(ids),
            ids_ends=np.cumsum([len(i) for i in ids]),
            labels=labels,
        )
    partial.replace(path)


def grey_mix(picture: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Grey as one of many sensors would see it: a random mixture of the channels about the usual one."""
    weights = rng.dirichlet(12 * np.array([0.114, 0.587, 0.299])) if rng.random() < 0.5 else [0.114, 0.587, 0.299]
    return np.clip(picture @ np.asarray(weights, np.float32), 0, 255).astype(np.uint8)


def _encoded(suffix: str, image: NDArray[np.uint8], options: list[int]) -> NDArray[np.uint8]:
    return np.asarray(cv2.imencode(suffix, image, options)[1], np.uint8).ravel()
