"""Finding features again in an earlier frame: those of an instance within it, those of the background near by."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

_MAX_HAMMING = 60
_NEAR_M = 2.0
_RATIO = 0.85  # of the best to the second best distance (Lowe 2004)


def match_within_instances(
    descriptor: NDArray[np.uint8],
    instance: NDArray[np.int32],
    earlier_descriptor: NDArray[np.uint8],
    earlier_instance: NDArray[np.int32],
) -> NDArray[np.int64]:
    """Row of the same point in the earlier frame, (N,), -1 for none; mutual best matches of the same instance.

    Args:
        descriptor, earlier_descriptor: (N, 32) and (M, 32) uint8.
        instance, earlier_instance: (N,) and (M,) ids, ascending.
    """
    nowhere = np.zeros((len(instance), 3))
    nowhere_earlier = np.zeros((len(earlier_instance), 3))
    bounds = [np.searchsorted(earlier_instance, instance, side=side) for side in ("left", "right")]
    back = [np.searchsorted(instance, earlier_instance, side=side) for side in ("left", "right")]
    return _mutual(descriptor, earlier_descriptor, nowhere, nowhere_earlier, bounds, back)


def match_near_by(
    descriptor: NDArray[np.uint8],
    position: NDArray[np.float64],
    earlier_descriptor: NDArray[np.uint8],
    earlier_position: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Row of the same point in the earlier frame, (N,), -1 for none; mutual best matches within two metres.

    Args:
        descriptor, earlier_descriptor: (N, 32) and (M, 32) uint8.
        position, earlier_position: (N, 3) and (M, 3) metres in the map.
    """
    n, m = len(descriptor), len(earlier_descriptor)
    bounds = [np.zeros(n, np.int64), np.full(n, m, np.int64)]
    back = [np.zeros(m, np.int64), np.full(m, n, np.int64)]
    return _mutual(descriptor, earlier_descriptor, position, earlier_position, bounds, back)


def _mutual(
    descriptor: NDArray[np.uint8],
    earlier_descriptor: NDArray[np.uint8],
    position: NDArray[np.float64],
    earlier_position: NDArray[np.float64],
    bounds: list[NDArray[np.int64]],
    back: list[NDArray[np.int64]],
) -> NDArray[np.int64]:
    """Best matches that choose each other, among the rows that the bounds (start and stop) allow."""
    words, earlier_words = (np.ascontiguousarray(d).view(np.uint64) for d in (descriptor, earlier_descriptor))
    forward = _best(words, earlier_words, position, earlier_position, *bounds)
    backward = _best(earlier_words, words, earlier_position, position, *back)
    rows = np.arange(len(forward))
    mutual = forward >= 0
    mutual[mutual] = backward[forward[mutual]] == rows[mutual]
    return np.where(mutual, forward, -1)


@numba.njit(cache=True, nogil=True)
def _bits(word: np.uint64) -> np.uint64:
    """Number of set bits."""
    word = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
    word = (word & np.uint64(0x3333333333333333)) + ((word >> np.uint64(2)) & np.uint64(0x3333333333333333))
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return (word * np.uint64(0x0101010101010101)) >> np.uint64(56)


@numba.njit(cache=True, nogil=True)
def _best(
    words: NDArray[np.uint64],
    others: NDArray[np.uint64],
    position: NDArray[np.float64],
    other_position: NDArray[np.float64],
    start: NDArray[np.int64],
    stop: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Row (N,) of the most alike of others[start:stop] near by each of the words (N, 4), -1 where none stands out."""
    rows = np.full(len(words), -1, np.int64)
    for i in range(len(words)):
        best, second = 257, 257
        for j in range(start[i], stop[i]):
            dx, dy = position[i, 0] - other_position[j, 0], position[i, 1] - other_position[j, 1]
            if dx * dx + dy * dy > _NEAR_M * _NEAR_M:
                continue
            distance = 0
            for w in range(4):
                distance += int(_bits(words[i, w] ^ others[j, w]))
            if distance < best:
                best, second = distance, best
                rows[i] = j
            elif distance < second:
                second = distance
        if best > _MAX_HAMMING or best > _RATIO * second:
            rows[i] = -1
    return rows
