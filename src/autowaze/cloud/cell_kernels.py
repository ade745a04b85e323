"""Loops over the ground cells of a diff, compiled: a diff has thousands, and hundreds of diffs come a second.

Columns `ix`, `iy`, `free`, `obstacle` (N,) are those of `world.ground.GroundCells`; codes are `spots.cell_codes`.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

_SHIFT = 32
_OFFSET = 1 << 31


@numba.njit(cache=True, nogil=True)
def blocks_of_cells(ix: NDArray[np.int32], iy: NDArray[np.int32], bits: int) -> NDArray[np.int64]:
    """Squares x, y (B, 2) of 2^bits by 2^bits cells that hold cells, each once, sorted by y, then x."""
    codes = np.empty(len(ix), np.int64)
    count = 0
    for cell in range(len(ix)):
        code = (np.int64(iy[cell] >> bits) << _SHIFT) | (np.int64(ix[cell] >> bits) + _OFFSET)
        # Cells come sorted, so most lie in the block of the one before.
        if count == 0 or codes[count - 1] != code:
            codes[count] = code
            count += 1
    blocks = np.empty((count, 2), np.int64)
    kept = 0
    before = np.int64(0)
    for code in np.sort(codes[:count]):
        if kept == 0 or code != before:
            blocks[kept, 0] = (code & 0xFFFF_FFFF) - _OFFSET
            blocks[kept, 1] = code >> _SHIFT
            kept += 1
            before = code
    return blocks[:kept]


@numba.njit(cache=True, nogil=True)
def cells_ascend(ix: NDArray[np.int32], iy: NDArray[np.int32]) -> bool:
    """Whether cells are sorted by iy, then ix, with no two the same."""
    for cell in range(1, len(ix)):
        if iy[cell] < iy[cell - 1] or (iy[cell] == iy[cell - 1] and ix[cell] <= ix[cell - 1]):
            return False
    return True


@numba.njit(cache=True, nogil=True)
def votes_of_codes(
    ix: NDArray[np.int32],
    iy: NDArray[np.int32],
    free: NDArray[np.uint16],
    obstacle: NDArray[np.uint16],
    codes: NDArray[np.int64],
) -> NDArray[np.uint8]:
    """Votes (2, C) free and obstacle, at most 255, for cells of these codes, 0 for cells that were not seen.

    Args:
        ix, iy, free, obstacle: sorted by iy, then ix.
        codes: (C,) in ascending runs, else in any order.
    """
    found = np.zeros((2, len(codes)), np.uint8)
    row, before = len(ix), np.int64(0)
    for number in range(len(codes)):
        code = codes[number]
        if number == 0 or code < before or row == len(ix):
            row = _first_not_below(ix, iy, code)
        elif row < len(ix) and _code(ix, iy, row) < code:
            row += 1
            if row < len(ix) and _code(ix, iy, row) < code:
                row = _first_not_below(ix, iy, code)
        before = code
        if row < len(ix) and _code(ix, iy, row) == code:
            found[0, number] = min(free[row], 255)
            found[1, number] = min(obstacle[row], 255)
    return found


@numba.njit(cache=True, nogil=True)
def any_between(votes: NDArray[np.uint8], starts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether there are votes (2, C) from each start (S + 1,) to the next, (S,)."""
    found = np.zeros(len(starts) - 1, np.bool_)
    for part in range(len(found)):
        for cell in range(starts[part], starts[part + 1]):
            if votes[0, cell] or votes[1, cell]:
                found[part] = True
                break
    return found


@numba.njit(cache=True, nogil=True)
def shares_of_passes(
    free: NDArray[np.uint8], obstacle: NDArray[np.uint8], core: NDArray[np.bool_], starts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Share (P, 2) of the core's cells (C,) that each pass saw free, and with obstacles.

    Args:
        free, obstacle: (W, C) votes of the windows of P passes.
        core: (C,) which cells count, at least one.
        starts: (P,) first window of each pass.
    """
    windows, cells = free.shape
    shares = np.zeros((len(starts), 2))
    for number in range(len(starts)):
        end = starts[number + 1] if number + 1 < len(starts) else windows
        mostly_free, mostly_obstacle, counted = 0, 0, 0
        for cell in range(cells):
            if not core[cell]:
                continue
            counted += 1
            sees_free, sees_obstacle = 0, 0
            for window in range(starts[number], end):
                sees_free += free[window, cell]
                sees_obstacle += obstacle[window, cell]
            mostly_free += sees_free > sees_obstacle
            mostly_obstacle += sees_obstacle > 0 and sees_obstacle >= sees_free
        shares[number, 0] = mostly_free / counted
        shares[number, 1] = mostly_obstacle / counted
    return shares


@numba.njit(cache=True, nogil=True)
def _code(ix: NDArray[np.int32], iy: NDArray[np.int32], row: int) -> np.int64:
    return (np.int64(iy[row]) << _SHIFT) + np.int64(ix[row])


@numba.njit(cache=True, nogil=True)
def _first_not_below(ix: NDArray[np.int32], iy: NDArray[np.int32], code: int) -> int:
    low, high = 0, len(ix)
    while low < high:
        middle = (low + high) // 2
        if _code(ix, iy, middle) < code:
            low = middle + 1
        else:
            high = middle
    return low
