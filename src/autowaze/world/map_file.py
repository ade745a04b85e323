"""Stored feature maps on disk: the bytes of `wire.encode_map`, written whole or not at all."""

from __future__ import annotations

from pathlib import Path

from autowaze.world.errors import MapFileError, WireError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.wire import decode_map, encode_map


def save_map(feature_map: FeatureMap, path: str | Path) -> int:
    """Write a map; returns its size in bytes. A crash leaves the old file as it was."""
    path = Path(path)
    data = encode_map(feature_map)
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_bytes(data)
        partial.replace(path)
    except OSError as error:
        raise MapFileError(f"{path}: cannot be written: {error.strerror}") from error
    return len(data)


def load_map(path: str | Path) -> FeatureMap:
    """Read a map.

    Raises:
        MapFileError: the file is missing or is no map.
    """
    path = Path(path)
    try:
        return decode_map(path.read_bytes())
    except OSError as error:
        raise MapFileError(
            f"{path}: cannot be read: {error.strerror}; make one with: autowaze map TRACE -o MAP"
        ) from error
    except WireError as error:
        raise MapFileError(f"{path}: not a feature map: {error}") from error
