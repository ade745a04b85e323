"""Compilation of the hot loops, and the one instruction that Hamming distances need."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.extending import intrinsic


def compiled(function: Callable[..., Any]) -> Any:
    """Compile to machine code that runs without the interpreter lock and is cached on disk.

    No fast-math: the same input gives the same bits on one machine, whatever the threads do.
    """
    return numba.njit(cache=True, nogil=True)(function)


def _popcount(_context: Any, word: Any) -> Any:

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return word(word), generate


popcount: Any = intrinsic(_popcount)
"""Number of set bits of an integer; callable from compiled code only."""


@compiled
def hamming(a, i, b, j):  # type: ignore[no-untyped-def]
    """Differing bits of descriptor i of a (N, 4) and j of b (M, 4), uint64 words.

    Rows are named by number: a slice would be a counted reference, which costs more than the comparison.
    """
    return (
        popcount(a[i, 0] ^ b[j, 0])
        + popcount(a[i, 1] ^ b[j, 1])
        + popcount(a[i, 2] ^ b[j, 2])
        + popcount(a[i, 3] ^ b[j, 3])
    )
