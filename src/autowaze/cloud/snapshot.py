"""The state of a service as bytes, so that a new process need not replay the whole log.

Parts of the service say with `kept` what they hold: numbers, text, bytes, lists, maps, numpy arrays and columns, copied
as far as they change in place; `restore` takes it back. Packed it is MessagePack in a zstd frame; reading it runs no
code that it brings.
"""

from __future__ import annotations

import threading
import time
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
_AWAKE_S, _RESTS = 0.001, 19
"""A service near its limit has no more than a twentieth of the interpreter to spare; with less its diffs queue up."""

Kept = dict[str, Any]


class SnapshotError(AutowazeError):
    """A snapshot that cannot be read, or is of another service; the log tells the same, at length."""


def pack(kept: Kept, hurry: threading.Event | None = None) -> bytes:
    """The bytes of what parts of a service hold.

    Args:
        kept: by name.
        hurry: until it is set, rest so often that diffs that are taken in meanwhile get nineteen twentieths of the
            interpreter; takes twenty times as long.
    """
    packer = msgpack.Packer(default=_packed, use_bin_type=True, autoreset=False)
    _write(packer, {"format": FORMAT, **kept}, 0, _no_rest if hurry is None else _Rests(hurry))
    return zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress(packer.getbuffer())


def unpack(data: bytes) -> Kept:
    """What was packed; raises `SnapshotError` if it is no snapshot of this format."""
    try:
        body = zstandard.ZstdDecompressor().decompress(data, max_output_size=MOST_BYTES)
        kept = msgpack.unpackb(body, ext_hook=_unpacked, strict_map_key=False)
    except (zstandard.ZstdError, ValueError, TypeError, msgpack.UnpackException) as error:
        raise SnapshotError(f"not a snapshot: {error}") from error
    if not isinstance(kept, dict) or kept.get("format") != FORMAT:
        raise SnapshotError(f"not a snapshot of format {FORMAT}")
    return kept


def _no_rest() -> None:
    pass


class _Rests:
    """Sleeps far longer than it was awake, until there is a hurry."""

    def __init__(self, hurry: threading.Event) -> None:
        self._hurry = hurry
        self._woke = time.perf_counter()

    def __call__(self) -> None:
        """Sleep, if it has been awake for a while."""
        awake_s = time.perf_counter() - self._woke
        if awake_s > _AWAKE_S:
            self._hurry.wait(_RESTS * awake_s)
            self._woke = time.perf_counter()


def _write(packer: Any, value: Any, depth: int, rest: Callable[[], None]) -> None:
    """Pack item by item as far down as containers are large: in one call nobody else could run meanwhile."""
    if depth < _DEPTH and isinstance(value, dict):
        packer.pack_map_header(len(value))
        for key, item in value.items():
            packer.pack(key)
            _write(packer, item, depth + 1, rest)
    elif depth < _DEPTH and isinstance(value, list):
        packer.pack_array_header(len(value))
        for item in value:
            _write(packer, item, depth + 1, rest)
    else:
        packer.pack(value)
        rest()


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
