"""Finding the features of an instance again in an earlier frame, by descriptor within the instance."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

_MAX_HAMMING = 60
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
    words, earlier_words = (np.ascontiguousarray(d).view(np.uint64) for d in (descriptor, earlier_descriptor))
    start = np.searchsorted(earlier_instance, instance, side="left")
    stop = np.searchsorted(earlier_instance, instance, side="right")
    forward = _best(words, earlier_words, start, stop)
    back_start = np.searchsorted(instance, earlier_instance, side="left")
    back_stop = np.searchsorted(instance, earlier_instance, side="right")
    backward = _best(earlier_words, words, back_start, back_stop)
    mutual = (forward >= 0) & (backward[forward] == np.arange(len(forward))) if len(backward) else forward >= 0
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
    words: NDArray[np.uint64], others: NDArray[np.uint64], start: NDArray[np.int64], stop: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Row (N,) of the nearest of others[start:stop] for each of the words (N, 4), -1 where none is clearly nearest."""
    rows = np.full(len(words), -1, np.int64)
    for i in range(len(words)):
        best, second = 257, 257
        for j in range(start[i], stop[i]):
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
