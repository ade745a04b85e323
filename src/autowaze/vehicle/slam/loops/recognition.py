"""Places that look alike: bags of words, a word being some bits of a descriptor.

Bit sampling is the locality-sensitive hashing of Hamming space (Indyk & Motwani 1998): like descriptors agree in a few
bits of theirs, unlike ones seldom do. Words are weighed by how rare they are (Sivic & Zisserman 2003); what is rare is
learnt from the drive itself, so no vocabulary is trained, shipped or loaded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.compiled import compiled

_TABLES, _BITS = 4, 16
_SAMPLED = np.random.default_rng(256).permutation(256)[: _TABLES * _BITS]  # a descriptor's bits, the same everywhere


class PlaceIndex:
    """The words of all places so far, and how many places have each word."""

    def __init__(self) -> None:
        self._words: list[NDArray[np.int32]] = []
        self._n_places = np.zeros(_TABLES << _BITS, np.int32)

    def __len__(self) -> int:
        return len(self._words)

    def add(self, descriptor: NDArray[np.uint8]) -> None:
        """File the next place by its descriptors (N, 32)."""
        words = bag_of_words(descriptor)
        self._words.append(words)
        self._n_places[words] += 1

    def forget(self, place: int) -> None:
        """Take a place out; it keeps its number."""
        self._n_places[self._words[place]] -= 1
        self._words[place] = np.zeros(0, np.int32)

    def likeness(self, place: int, others: NDArray[np.int64]) -> NDArray[np.float64]:
        """How alike a place is to others (M,): the rarity of the words that they share, over that of all."""
        rarity = np.log((1.0 + len(self._words)) / (1.0 + self._n_places))
        own = self._words[place]
        norm = np.sqrt(rarity[own].sum())
        score = np.zeros(len(others))
        for i, other in enumerate(others):
            words = self._words[other]
            if len(words):
                score[i] = _shared(own, words, rarity) / (norm * np.sqrt(rarity[words].sum()) + 1e-9)
        return score


def bag_of_words(descriptor: NDArray[np.uint8]) -> NDArray[np.int32]:
    """The different words (W,) of descriptors (N, 32), sorted."""
    bits = np.unpackbits(descriptor, axis=1)[:, _SAMPLED]
    word = np.ascontiguousarray(np.packbits(bits, axis=1)).view(np.uint16).astype(np.int32)
    return np.unique(word + (np.arange(_TABLES, dtype=np.int32) << _BITS))


@compiled
def _shared(a, b, rarity):  # type: ignore[no-untyped-def]
    """Sum of the rarities of the words that two sorted lists share."""
    total = 0.0
    i, j = 0, 0
    while i < a.shape[0] and j < b.shape[0]:
        if a[i] == b[j]:
            total += rarity[a[i]]
            i += 1
            j += 1
        elif a[i] < b[j]:
            i += 1
        else:
            j += 1
    return total
