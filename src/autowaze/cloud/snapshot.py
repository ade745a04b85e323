"""The state of a service as bytes, so that a new process need not replay the whole log.

Parts of the service say with `kept` what they hold: numbers, text, bytes, lists, maps, numpy arrays and columns, copied
as far as they change in place; `restore` takes it back. Packed it is MessagePack in a zstd frame; reading it runs no
code that it brings.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
import zstandard

from autowaze.world.columns import Columns, names_of
from autowaze.world.errors import AutowazeError
from autowaze.world.parking import SpotState

FORMAT = 1
MOST_BYTES = 1 << 34
_ARRAY = 1
_ZSTD_LEVEL = 3
_DEPTH = 5
_PART_BYTES = 1 << 20

Kept = dict[str, Any]


class SnapshotError(AutowazeError):
    """A snapshot that cannot be read, or is of another service; the log tells the same, at length."""


def pack(kept: Kept) -> bytes:
    """The bytes of what parts of a service hold, by name."""
    parts: list[bytes] = []
    pack_into(parts.append, kept)
    return b"".join(parts)


def pack_into(take: Callable[[bytes], object], kept: Kept) -> None:
    """Hand on the bytes of what parts of a service hold, part by part."""
    frame = zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compressobj()
    packer = msgpack.Packer(default=_packed, use_bin_type=True, autoreset=False)

    def flush(least: int = _PART_BYTES) -> None:
        if len(packer.getbuffer()) >= least:
            part = frame.compress(packer.getbuffer())
            packer.reset()
            if part:
                take(part)

    _write(packer, {"format": FORMAT, **kept}, 0, flush)
    flush(0)
    take(frame.flush())


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


def _write(packer: Any, value: Any, depth: int, flush: Callable[[], None]) -> None:
    """Pack item by item as far down as containers are large: the whole of a city's map is never in one buffer."""
    if depth < _DEPTH and isinstance(value, dict):
        packer.pack_map_header(len(value))
        for key, item in value.items():
            packer.pack(key)
            _write(packer, item, depth + 1, flush)
    elif depth < _DEPTH and isinstance(value, list):
        packer.pack_array_header(len(value))
        for item in value:
            _write(packer, item, depth + 1, flush)
    else:
        packer.pack(value)
        flush()


def _packed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        head = msgpack.packb((value.dtype.str, value.shape))
        return msgpack.ExtType(_ARRAY, head + np.ascontiguousarray(value).tobytes())
    if isinstance(value, Columns):
        return {name: getattr(value, name) for name in names_of(type(value))}
    if isinstance(value, SpotState):
        return value.plain
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be kept in a snapshot")


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
