"""A sparse grid of three classes as a small byte string.

Free ground and obstacles come in patches, so that a cell's neighbours foretell it: each cell is coded with an adaptive
arithmetic coder (the carry-propagating range coder of LZMA) under a model of the four neighbours that reader and
writer have both seen already, as JBIG (ITU-T T.82) codes bilevel images. Cells are asked two questions: seen at all?
and if so, obstacle? Squares of 16 by 16 cells without any are left out by one question each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from autowaze.world.errors import WireError

BLOCK = 16
"""Cells along the edge of a square."""
MAX_SQUARES = 1 << 14
"""Of the rectangle around all cells: 512 m by 512 m."""
MAX_SEEN_SQUARES = 1 << 10
"""With cells in them: what a car sees along 600 m of road."""

_NEIGHBOURS = 4
_CONTEXTS = 3**_NEIGHBOURS
_STEP = 24
"""What one cell adds to the count of its answer; divisible by the numbers of neighbours that may answer."""
_PRIOR_CELLS = 2
"""Weight of the neighbours' answers before any cell was seen in their company."""
_MOST = 1 << 14
_PROBABILITY_BITS = 15
_TOP = 1 << 24
_MASK = 0xFFFFFFFF
_FLUSH_BYTES = 5


def pack_classes(squares: NDArray[np.uint8]) -> bytes:
    """Bytes of a grid (H, W) uint8 of 0 unseen, 1 free, 2 obstacle; H and W are multiples of `BLOCK`."""
    out = np.empty(3 * squares.size + 64, np.uint8)  # two questions a cell, of ten bits each at most
    length = _encode(np.ascontiguousarray(squares), out)
    return out[1:length].tobytes().rstrip(b"\0")  # the first byte is 0 always; a reader goes on with zeros


def unpack_classes(data: bytes, height: int, width: int, what: str) -> NDArray[np.uint8]:
    """The grid (height, width) of `pack_classes`; whatever the bytes, it is one.

    Raises:
        WireError: it is larger than a grid may be, or more of it is seen than may be.
    """
    grid, _ = _unpacked(data, height, width, what)
    return grid


class SeenCells(NamedTuple):
    """Cells (N,) of a grid that were seen, row by row, each as one vote."""

    ix: NDArray[np.int32]
    iy: NDArray[np.int32]
    free: NDArray[np.uint16]
    obstacle: NDArray[np.uint16]


def unpack_cells(data: bytes, height: int, width: int, what: str) -> SeenCells:
    """The cells of `unpack_classes` that were seen; raises as that does."""
    grid, count = _unpacked(data, height, width, what)
    return SeenCells(*_seen_cells(grid, count))


def _unpacked(data: bytes, height: int, width: int, what: str) -> tuple[NDArray[np.uint8], int]:
    """The grid, and how many of its cells were seen."""
    if height % BLOCK or width % BLOCK or height < 0 or width < 0 or height * width > MAX_SQUARES * BLOCK**2:
        raise WireError(f"{what}: {height} by {width} cells are no grid")
    grid = np.zeros((height, width), np.uint8)
    count = int(_decode(np.frombuffer(b"\0" + data, np.uint8), grid, MAX_SEEN_SQUARES))
    if count < 0:
        raise WireError(f"{what}: more than {MAX_SEEN_SQUARES} squares are seen")
    return grid, count


@njit(cache=True, nogil=True)
def _counts():  # type: ignore[no-untyped-def]
    """Counts (2, contexts, 2) of no and yes for each question, as the neighbours suggest."""
    counts = np.empty((2, _CONTEXTS, 2), np.int64)
    for context in range(_CONTEXTS):
        seen = obstacles = 0
        rest = context
        for _ in range(_NEIGHBOURS):
            seen += rest % 3 > 0
            obstacles += rest % 3 > 1
            rest //= 3
        for question in range(2):
            yes, of = (seen, _NEIGHBOURS) if question == 0 else (obstacles, seen)
            yes = _STEP * yes // of if of else _STEP // 3
            counts[question, context, 0] = _PRIOR_CELLS * (_STEP - yes) + 2
            counts[question, context, 1] = _PRIOR_CELLS * yes + 2
    return counts


@njit(cache=True, nogil=True)
def _probability(count):  # type: ignore[no-untyped-def]
    """Of yes, in units of 2^-15, never certain."""
    p = (count[1] << _PROBABILITY_BITS) // (count[0] + count[1])
    return np.uint64(min(max(p, 1 << 5), (1 << _PROBABILITY_BITS) - (1 << 5)))


@njit(cache=True, nogil=True)
def _learn(count, answer):  # type: ignore[no-untyped-def]
    count[answer] += _STEP
    if count[0] + count[1] > _MOST:
        count[0] = (count[0] + 1) // 2
        count[1] = (count[1] + 1) // 2


@njit(cache=True, nogil=True)
def _context(grid, y, x):  # type: ignore[no-untyped-def]
    """Number of what west, north, north-west and north-east of a cell say."""
    west = grid[y, x - 1] if x > 0 else 0
    north = grid[y - 1, x] if y > 0 else 0
    north_west = grid[y - 1, x - 1] if x > 0 and y > 0 else 0
    north_east = grid[y - 1, x + 1] if y > 0 and x + 1 < grid.shape[1] else 0
    return west + 3 * north + 9 * north_west + 27 * north_east


@njit(cache=True, nogil=True)
def _shift(state, out):  # type: ignore[no-untyped-def]
    """Move the top byte of `low` out. `state`: low, range, waiting byte, number waiting, bytes out."""
    low = state[0]
    if low < np.uint64(0xFF000000) or low > np.uint64(_MASK):
        carry = low >> np.uint64(32)
        byte = state[2]
        while state[3] > np.uint64(0):
            out[state[4]] = np.uint8((byte + carry) & np.uint64(0xFF))
            state[4] += np.uint64(1)
            byte = np.uint64(0xFF)
            state[3] -= np.uint64(1)
        state[2] = (low >> np.uint64(24)) & np.uint64(0xFF)
    state[3] += np.uint64(1)
    state[0] = (low & np.uint64(0x00FFFFFF)) << np.uint64(8)


@njit(cache=True, nogil=True)
def _put(state, out, count, answer):  # type: ignore[no-untyped-def]
    bound = (state[1] >> np.uint64(_PROBABILITY_BITS)) * _probability(count)
    if answer:
        state[1] = bound
    else:
        state[0] += bound
        state[1] -= bound
    _learn(count, answer)
    while state[1] < np.uint64(_TOP):
        state[1] = (state[1] << np.uint64(8)) & np.uint64(_MASK)
        _shift(state, out)


@njit(cache=True, nogil=True)
def _encode(grid, out):  # type: ignore[no-untyped-def]
    """Write the grid; returns the number of bytes."""
    state = np.array([0, _MASK, 0, 1, 0], np.uint64)
    counts, blocks = _counts(), _counts()
    rows, columns = grid.shape[0] // BLOCK, grid.shape[1] // BLOCK
    seen = np.zeros((rows, columns), np.uint8)
    for r in range(rows):
        for c in range(columns):
            square = grid[r * BLOCK : (r + 1) * BLOCK, c * BLOCK : (c + 1) * BLOCK]
            seen[r, c] = 1 if square.any() else 0
            _put(state, out, blocks[0, _context(seen, r, c)], seen[r, c])
    for y in range(grid.shape[0]):
        for x in range(grid.shape[1]):
            if seen[y // BLOCK, x // BLOCK]:
                context = _context(grid, y, x)
                value = grid[y, x]
                _put(state, out, counts[0, context], 1 if value > 0 else 0)
                if value > 0:
                    _put(state, out, counts[1, context], 1 if value > 1 else 0)
    # Of the numbers that mean the same, the one that ends in most zeros.
    last = state[0] + state[1] - np.uint64(1)
    for bits in range(32, -1, -1):
        rounded = (last >> np.uint64(bits)) << np.uint64(bits)
        if rounded >= state[0]:
            state[0] = rounded
            break
    for _ in range(_FLUSH_BYTES):
        _shift(state, out)
    return int(state[4])


@njit(cache=True, nogil=True)
def _ask(state, data, count):  # type: ignore[no-untyped-def]
    """The next answer. `state`: code, range, bytes read."""
    bound = (state[1] >> np.uint64(_PROBABILITY_BITS)) * _probability(count)
    answer = 1 if state[0] < bound else 0
    if answer:
        state[1] = bound
    else:
        state[0] -= bound
        state[1] -= bound
    _learn(count, answer)
    while state[1] < np.uint64(_TOP):
        byte = data[state[2]] if state[2] < np.uint64(len(data)) else np.uint8(0)
        state[0] = ((state[0] << np.uint64(8)) | np.uint64(byte)) & np.uint64(_MASK)
        state[1] = (state[1] << np.uint64(8)) & np.uint64(_MASK)
        state[2] += np.uint64(1)
    return answer


@njit(cache=True, nogil=True)
def _decode(data, grid, most_seen):  # type: ignore[no-untyped-def]
    """Fill the grid; returns how many cells were seen, -1 if more squares were than may be."""
    state = np.array([0, _MASK, 0], np.uint64)
    for _ in range(_FLUSH_BYTES):
        byte = data[state[2]] if state[2] < np.uint64(len(data)) else np.uint8(0)
        state[0] = ((state[0] << np.uint64(8)) | np.uint64(byte)) & np.uint64(_MASK)
        state[2] += np.uint64(1)
    counts, blocks = _counts(), _counts()
    rows, columns = grid.shape[0] // BLOCK, grid.shape[1] // BLOCK
    seen = np.zeros((rows, columns), np.uint8)
    n_seen = 0
    for r in range(rows):
        for c in range(columns):
            seen[r, c] = _ask(state, data, blocks[0, _context(seen, r, c)])
            n_seen += seen[r, c]
            if n_seen > most_seen:
                return -1
    n_cells = 0
    for y in range(grid.shape[0]):
        for c in range(columns):
            if not seen[y // BLOCK, c]:
                continue
            for x in range(c * BLOCK, (c + 1) * BLOCK):
                context = _context(grid, y, x)
                if _ask(state, data, counts[0, context]):
                    grid[y, x] = 1 + _ask(state, data, counts[1, context])
                    n_cells += 1
    return n_cells


@njit(cache=True, nogil=True)
def _seen_cells(grid, count):  # type: ignore[no-untyped-def]
    ix, iy = np.empty(count, np.int32), np.empty(count, np.int32)
    free, obstacle = np.empty(count, np.uint16), np.empty(count, np.uint16)
    row = 0
    for y in range(grid.shape[0]):
        for x in range(grid.shape[1]):
            if grid[y, x] > 0:
                ix[row], iy[row] = x, y
                free[row], obstacle[row] = grid[y, x] == 1, grid[y, x] > 1
                row += 1
    return ix, iy, free, obstacle
