"""Integers and unit vectors as small byte strings.

A column is one byte that says how it is packed, then the values, zigzag-coded, in the fewest bytes that hold the
largest, byte plane by byte plane (which zstd then compresses well); or the first value and, packed so, the differences
that follow. Readers check every length before they allocate, so that bytes from a stranger cost no more than they
weigh.
"""

from __future__ import annotations

from collections.abc import Sequence

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
    column: NDArray[np.int64] = unpack_columns(((what, data, low, high),), count)[0]
    return column


def unpack_columns(columns: Sequence[tuple[str, bytes, int, int]], count: int) -> NDArray[np.int64]:
    """The int64 values (K, count) of K columns of the same rows, each given by name, bytes, lowest and highest value.

    Raises:
        WireError: as `unpack_integers`; names the column.
    """
    table = np.empty((len(columns), count), np.int64)
    if count == 0:
        for what, data, _, _ in columns:
            if data:
                raise WireError(f"{what}: {len(data)} bytes for no values")
        return table
    ends = np.cumsum([len(data) for _, data, _, _ in columns])
    joined = np.frombuffer(b"".join([data for _, data, _, _ in columns]), np.uint8)
    wrong, is_bound = _unpacked(joined, ends, np.array([column[2:] for column in columns]), table)
    if wrong >= 0:
        what, data, low, high = columns[wrong]
        if is_bound:
            raise WireError(f"{what}: a value lies outside {low}..{high}")
        raise WireError(f"{what}: {len(data)} bytes do not hold {count} values")
    return table


@njit(
    "Tuple((int64, boolean))(Array(uint8, 1, 'C', readonly=True), int64[::1], int64[:, ::1], int64[:, ::1])",
    cache=True,
    nogil=True,
)
def _unpacked(joined, ends, bounds, table):  # type: ignore[no-untyped-def]
    """Fill the table (K, count > 0) from columns that end there; which one is wrong, -1 for none, and if by a bound.

    Columns are zigzag byte planes, lowest byte first; of differences, where a first value precedes them.
    """
    at = 0
    for k in range(len(ends)):
        end, rows, row = ends[k], table.shape[1], 0
        total = np.int64(0)
        delta = at < end and (joined[at] & _DELTA) != 0
        if delta:
            width = joined[at] & _WIDTH_MASK
            at += 1
            if width > 8 or at + width > end:
                return k, False
            zigzag = np.uint64(0)
            for plane in range(width):
                zigzag |= np.uint64(joined[at + plane]) << np.uint64(8 * plane)
            at += width
            total = np.int64(zigzag >> np.uint64(1)) ^ -np.int64(zigzag & np.uint64(1))
            table[k, 0], row = total, 1
            rows -= 1
        if at >= end or joined[at] > 8 or end - at != 1 + np.int64(joined[at]) * rows:
            return k, False
        width = joined[at]
        at += 1
        for number in range(rows):
            zigzag = np.uint64(0)
            for plane in range(width):
                zigzag |= np.uint64(joined[at + plane * rows + number]) << np.uint64(8 * plane)
            value = np.int64(zigzag >> np.uint64(1)) ^ -np.int64(zigzag & np.uint64(1))
            total = total + value if delta else value  # wraps, as the sums of two's complement do
            table[k, row + number] = total
        at = end
        for number in range(table.shape[1]):
            if table[k, number] < bounds[k, 0] or table[k, number] > bounds[k, 1]:
                return k, True
    return -1, False


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
    return np.asarray(_normals(np.frombuffer(data, np.uint8), count))


@njit("float32[:, ::1](Array(uint8, 1, 'C', readonly=True), int64)", cache=True, nogil=True)
def _normals(data, count):  # type: ignore[no-untyped-def]
    normals = np.empty((count, 3), np.float32)
    for row in range(count):
        x, y = data[row] / 127.0 - 1.0, data[count + row] / 127.0 - 1.0
        z = 1.0 - (abs(x) + abs(y))
        folded = max(-z, 0.0)
        x = x - folded if x >= 0 else x + folded
        y = y - folded if y >= 0 else y + folded
        norm = max(np.sqrt(x * x + y * y + z * z), 1e-12)
        normals[row, 0], normals[row, 1], normals[row, 2] = x / norm, y / norm, z / norm
    return normals
