"""Integers and unit vectors as small byte strings.

A column is one byte that says how it is packed, then the values, zigzag-coded, in the fewest bytes that hold the
largest, byte plane by byte plane (which zstd then compresses well); or the first value and, packed so, the differences
that follow. Readers check every length before they allocate, so that bytes from a stranger cost no more than they
weigh.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from autowaze.world.errors import WireError

_DELTA = 0x10
_WIDTH_MASK = 0x0F


def pack_integers(values: ArrayLike, delta: bool = False) -> bytes:
    """Column of int64 values (N,); an empty column is an empty string."""
    column = np.asarray(values, dtype=np.int64)
    if len(column) == 0:
        return b""
    if not delta:
        return _planes(column, 0)
    return _planes(column[:1], _DELTA) + _planes(np.diff(column), 0)


def _planes(column: NDArray[np.int64], flags: int) -> bytes:
    """How many byte planes there are, with flags, and the planes."""
    zigzag = ((column << 1) ^ (column >> 63)).astype(np.uint64)
    width = (int(zigzag.max(initial=0)).bit_length() + 7) // 8
    return bytes([width | flags]) + zigzag.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T.tobytes()


def unpack_integers(data: bytes, count: int, low: int, high: int, what: str) -> NDArray[np.int64]:
    """The int64 values (count,) of a column.

    Raises:
        WireError: the length does not fit the count, or a value lies outside low..high.
    """
    if count == 0:
        if data:
            raise WireError(f"{what}: {len(data)} bytes for no values")
        return np.zeros(0, np.int64)
    first, rows = 0, count
    if data and data[0] & _DELTA:
        after = 1 + (data[0] & _WIDTH_MASK)
        zigzag = int.from_bytes(data[1:after], "little")
        first, rows, rest = (zigzag >> 1) ^ -(zigzag & 1), count - 1, data[after:]
        delta = True
    else:
        rest, delta = data, False
    width = rest[0] if rest else -1
    if not 0 <= width <= 8 or len(rest) != 1 + width * rows or not -(1 << 63) <= first < 1 << 63:
        raise WireError(f"{what}: {len(data)} bytes do not hold {count} values")
    column: NDArray[np.int64]
    column, smallest, largest = _unpacked(np.frombuffer(rest, np.uint8, offset=1), width, count, delta, first)
    if smallest < low or largest > high:
        raise WireError(f"{what}: a value lies outside {low}..{high}")
    return column


@njit(
    "Tuple((int64[::1], int64, int64))(Array(uint8, 1, 'C', readonly=True), int64, int64, boolean, int64)", cache=True
)
def _unpacked(planes, width, count, delta, first):  # type: ignore[no-untyped-def]
    """Values (count,) of zigzag byte planes, lowest byte first, and of a first value where they are differences.

    With the smallest and the largest of them.
    """
    column = np.empty(count, np.int64)
    total = first
    smallest, largest = np.int64(np.iinfo(np.int64).max), np.int64(np.iinfo(np.int64).min)
    rows = count - 1 if delta else count
    if delta:
        column[0] = smallest = largest = first
    for row in range(rows):
        zigzag = np.uint64(0)
        for plane in range(width):
            zigzag |= np.uint64(planes[plane * rows + row]) << np.uint64(8 * plane)
        value = np.int64(zigzag >> np.uint64(1)) ^ -np.int64(zigzag & np.uint64(1))
        total = total + value if delta else value  # wraps, as the sums of two's complement do
        column[count - rows + row] = total
        smallest, largest = min(smallest, total), max(largest, total)
    return column, smallest, largest


def pack_bits(mask: NDArray[np.bool_]) -> bytes:
    """Bit mask (N,), eight to a byte."""
    return bytes(np.packbits(mask))


def unpack_bits(data: bytes, count: int, what: str) -> NDArray[np.bool_]:
    """Bit mask (count,)."""
    if len(data) != (count + 7) // 8:
        raise WireError(f"{what}: {len(data)} bytes do not hold {count} bits")
    return np.unpackbits(np.frombuffer(data, np.uint8), count=count).astype(np.bool_)


def pack_normals(normals: NDArray[np.floating]) -> bytes:
    """Unit vectors (N, 3) as two bytes each: octahedral map (Meyer et al. 2010), error below 1 degree."""
    n = np.asarray(normals, dtype=np.float64)
    n = n / np.maximum(np.abs(n).sum(axis=1, keepdims=True), 1e-12)
    fold = n[:, 2] < 0
    xy = n[:, :2].copy()
    xy[fold] = (1.0 - np.abs(n[fold][:, [1, 0]])) * np.where(n[fold, :2] >= 0, 1.0, -1.0)
    return bytes(np.round((xy + 1.0) * 127.0).astype(np.uint8).T.tobytes())


def unpack_normals(data: bytes, count: int, what: str) -> NDArray[np.float32]:
    """Unit vectors (count, 3)."""
    if len(data) != 2 * count:
        raise WireError(f"{what}: {len(data)} bytes do not hold {count} unit vectors")
    xy = np.frombuffer(data, np.uint8).reshape(2, count).T.astype(np.float64) / 127.0 - 1.0
    z = 1.0 - np.abs(xy).sum(axis=1)
    folded = np.maximum(-z, 0.0)[:, None]
    xy = xy - np.where(xy >= 0, folded, -folded)
    n = np.concatenate([xy, z[:, None]], axis=1)
    return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12), dtype=np.float32)
