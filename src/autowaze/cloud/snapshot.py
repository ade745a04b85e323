"""The state of a service as bytes, so that a new process need not replay the whole log.

Parts of the service say with `kept` what they hold: numbers, text, bytes, lists, maps, numpy arrays, columns, and what
has a `plain` form of these, copied as far as they change in place; `restore` takes it back. Packed it is MessagePack in
a zstd frame; reading it runs no code that it brings.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import msgpack
import numpy as np
import zstandard

from autowaze.world.columns import Columns, names_of
from autowaze.world.errors import AutowazeError

FORMAT = 3
MOST_BYTES = 1 << 34
_ARRAY = 1
_ZSTD_LEVEL = 3
_DEPTH, _FEW = 5, 64
"""How far down containers are taken apart, and lists as short as this are not."""
_PART_BYTES = 1 << 17
"""Diffs wait while one is packed or written."""
_AWAKE_S, _RESTS = 0.005, 9.0

Kept = dict[str, Any]


class SnapshotError(AutowazeError):
    """A snapshot that cannot be read, or is of another service; the log tells the same, at length."""


class GivenUpError(SnapshotError):
    """Nobody wants the snapshot any more."""


def pack(kept: Kept) -> bytes:
    """The bytes of what parts of a service hold, by name."""
    return b"".join(packed_parts(kept))


def packed_parts(kept: Kept, until: threading.Event | None = None) -> Iterator[bytes]:
    """The same bytes part by part, so that the whole is never in one piece.

    Args:
        kept: what parts of a service hold, by name.
        until: with this it rests nine times as long as it works, so that a busy service goes on beside it; and gives
            up when it is set.

    Raises:
        SnapshotError: something in it is of no kind that can be kept.
        GivenUpError: `until` was set.
    """
    frame = zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compressobj()
    packer = msgpack.Packer(default=_packed, use_bin_type=True, autoreset=False)
    woke = time.perf_counter()
    for _ in _steps(packer, {"format": FORMAT, **kept}, 0):
        if len(packer.getbuffer()) >= _PART_BYTES:
            part = frame.compress(packer.getbuffer())
            packer.reset()
            if part:
                yield part
        if until is not None and (awake_s := time.perf_counter() - woke) > _AWAKE_S:
            if until.wait(_RESTS * awake_s):
                raise GivenUpError("a snapshot was given up")
            woke = time.perf_counter()
    yield frame.compress(packer.getbuffer()) + frame.flush()


def unpack(data: bytes) -> Kept:
    """What was packed; raises `SnapshotError` if it is no snapshot of this format."""
    try:
        kept = msgpack.unpackb(_decompressed(data), ext_hook=_unpacked, strict_map_key=False)
    except (zstandard.ZstdError, ValueError, TypeError, msgpack.UnpackException) as error:
        raise SnapshotError(f"not a snapshot: {error}") from error
    if not isinstance(kept, dict) or kept.get("format") != FORMAT:
        raise SnapshotError(f"not a snapshot of format {FORMAT}")
    return kept


def _decompressed(data: bytes) -> bytearray:
    body = bytearray()
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        while part := reader.read(_PART_BYTES):
            body += part
            if len(body) > MOST_BYTES:
                raise ValueError(f"more than {MOST_BYTES} bytes")
    return body


def _steps(packer: Any, value: Any, depth: int) -> Iterator[None]:
    """Pack item by item as far down as containers are large: the whole of a city's map is never in one buffer, and no
    other thread waits for it."""
    if depth < _DEPTH and isinstance(value, dict):
        packer.pack_map_header(len(value))
        for key, item in value.items():
            packer.pack(key)
            yield from _steps(packer, item, depth + 1)
    elif depth < _DEPTH and isinstance(value, list) and len(value) > _FEW:
        packer.pack_array_header(len(value))
        for item in value:
            yield from _steps(packer, item, depth + 1)
    else:
        packer.pack(value)
        yield


def _packed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return msgpack.ExtType(_ARRAY, _head(value.dtype, value.shape) + value.tobytes())
    if isinstance(value, Columns):
        return {name: getattr(value, name) for name in names_of(type(value))}
    if (plain := getattr(value, "plain", None)) is not None:
        return plain
    if isinstance(value, np.generic):
        return value.item()
    raise SnapshotError(f"{type(value).__name__} cannot be kept in a snapshot")


@lru_cache(1024)
def _head(dtype: np.dtype[Any], shape: tuple[int, ...]) -> bytes:
    """What stands before the values of an array."""
    return bytes(msgpack.packb((dtype.str, shape)))


def _unpacked(code: int, data: bytes) -> Any:
    if code != _ARRAY:
        raise ValueError(f"extension {code} is unknown")
    unpacker = msgpack.Unpacker()
    unpacker.feed(data[:256])
    dtype, shape = unpacker.unpack()
    kind = np.dtype(dtype)
    if kind.hasobject:
        raise ValueError("an array of objects")
    # A copy: what is read from bytes cannot be written to.
    return np.frombuffer(data, kind, offset=unpacker.tell()).reshape(shape).copy()
