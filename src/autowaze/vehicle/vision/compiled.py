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
def hamming(a: Any, b: Any) -> Any:
    """Differing bits of two descriptors of four uint64 words each."""
    return popcount(a[0] ^ b[0]) + popcount(a[1] ^ b[1]) + popcount(a[2] ^ b[2]) + popcount(a[3] ^ b[3])
