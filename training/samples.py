"""The stream of training samples: rendered pictures, cropped and made hard."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import IterableDataset, get_worker_info

from training.crops import crop, normalised, targets
from training.hardening import hardened
from training.rows import with_rows

_ROWS = 0.3
"""Share of the crops into which vehicles of the one before are put."""


class Samples(IterableDataset):  # type: ignore[type-arg]
    """Endless samples of a folder of rendered streets: image (1, H, W) float32 and the targets of `crops.targets`.

    They begin easy: a new network learns in minutes from plain pictures what hard ones would not teach it in an hour.

    Args:
        first: number of the first sample.
        hard_from: number of the sample from which hardness stays at `hardness`.
    """

    def __init__(self, folder: Path, seed: int, first: int, hard_from: int, hardness: float) -> None:
        self._folder, self._seed = folder, seed
        self._first, self._hard_from, self._hardness = first, hard_from, hardness

    def __iter__(self) -> Iterator[tuple[torch.Tensor, ...]]:
        worker = get_worker_info()
        cv2.setNumThreads(1)
        rng = np.random.default_rng([self._seed, worker.id if worker else 0])
        number = self._first
        before = None
        while True:
            # the folder may still be growing
            streets = sorted(self._folder.glob("street-*.npz"))
            for grey, ids, labels in _shuffled(streets, rng):
                for _ in range(2):
                    image, crop_ids = crop(grey, ids, labels, rng)
                    own, own_labels = (image, crop_ids, labels), labels
                    if before is not None and rng.random() < _ROWS:
                        image, crop_ids, own_labels = with_rows(image, crop_ids, labels, before, rng)
                    before = own
                    hardness = self._hardness * min(1.0, number / max(self._hard_from, 1))
                    image, crop_ids = hardened(image, crop_ids, rng, hardness)
                    number += 1
                    sample = normalised(image)[None], *targets(crop_ids, own_labels)
                    yield tuple(torch.from_numpy(array) for array in sample)


def _shuffled(
    streets: list[Path], rng: np.random.Generator, at_once: int = 6
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]]:
    """A few pictures of a few streets at a time, so that a batch is mixed and memory stays small."""
    chosen = [streets[i] for i in rng.permutation(len(streets))[:at_once]]
    opened = [dict(np.load(path)) for path in chosen]
    pictures = [(s, i) for s, data in enumerate(opened) for i in range(len(data["labels"]))]
    for index in rng.permutation(len(pictures))[: max(len(pictures) // 2, 1)]:
        s, i = pictures[index]
        data = opened[s]
        yield _picture(data, "grey", i), _picture(data, "ids", i), data["labels"][i]


def _picture(data: dict[str, NDArray[np.uint8]], name: str, index: int) -> NDArray[np.uint8]:
    ends = data[f"{name}_ends"]
    start = ends[index - 1] if index else 0
    return np.asarray(cv2.imdecode(data[name][start : ends[index]], cv2.IMREAD_UNCHANGED), np.uint8)
