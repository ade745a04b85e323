"""Fewer points that still show the whole shape: even in space, and always the same ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FINEST_M = 0.02
_BITS = 21
"""Per axis in a cell's code: 2^21 cells of 2 cm are 42 km; points farther apart than that share cells, no more."""


def thinned_evenly(position: NDArray[np.float64], ids: NDArray[np.uint64], limit: int) -> NDArray[np.int64]:
    """Rows of at most so many points, sorted: one of every cubic cell, the cells as small as the limit allows.

    Which point stands for its cell follows from a hash of its id, so it stays the same when others come and go. What
    is then left of the limit is filled with others, by the same hash.

    Args:
        position: (N, 3) metres.
        ids: (N,) unique.
        limit: how many rows at most.
    """
    if len(position) <= limit:
        return np.arange(len(position))
    order = np.argsort(mixed(ids), kind="stable")
    low = position.min(axis=0)
    finest = np.floor((position[order] - low) / FINEST_M).astype(np.uint64)
    coarse, fine = 0, _BITS  # cells of 2^coarse are too many, those of 2^fine are few enough
    while fine - coarse > 1:
        middle = (coarse + fine) // 2
        coarse, fine = (coarse, middle) if len(np.unique(_codes(finest, middle))) <= limit else (middle, fine)
    first = np.unique(_codes(finest, fine), return_index=True)[1]
    chosen = np.zeros(len(position), np.bool_)
    chosen[first] = True
    rest = np.flatnonzero(~chosen)[: limit - len(first)]
    return np.sort(order[np.append(first, rest)])


def share_of(ids: NDArray[np.uint64], share: float) -> NDArray[np.bool_]:
    """A mask (N,) of about this share of the points, always the same ones."""
    if share >= 1.0:
        return np.ones(len(ids), np.bool_)
    return np.asarray(mixed(ids) < np.uint64(int(max(share, 0.0) * float(1 << 64))))


def mixed(ids: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """A hash (N,) of ids (N,): the finaliser of splitmix64 (Steele et al. 2014)."""
    with np.errstate(over="ignore"):
        z = ids + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return np.asarray(z ^ (z >> np.uint64(31)))


def _codes(finest: NDArray[np.uint64], level: int) -> NDArray[np.uint64]:
    cell = (finest >> np.uint64(level)) & np.uint64((1 << _BITS) - 1)
    return np.asarray((cell[:, 0] << np.uint64(2 * _BITS)) | (cell[:, 1] << np.uint64(_BITS)) | cell[:, 2])
