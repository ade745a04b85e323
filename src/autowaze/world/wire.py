"""Semantic map diffs, feature maps and map updates as bytes.

A protobuf envelope with a version; inside a zstd frame of a protobuf message whose numeric arrays are packed columns
(`column_codec`), fixed-point: positions 1 cm. docs/wire-format.md is the specification. `decode_*` survive any bytes:
they return a valid object or raise `WireError`, within `MAX_BODY_BYTES` of input.
"""

from __future__ import annotations

import math

import numpy as np
import zstandard
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from autowaze.world import wire_pb2 as pb
from autowaze.world.column_codec import pack_integers, unpack_integers
from autowaze.world.errors import WireError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.identity import (
    MAX_FEATURES_PER_DIFF,
    MAX_INSTANCE,
    MAX_SEQUENCE,
    MAX_SESSION,
    feature_ids,
    instance_keys,
)
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.map_update import MapUpdate
from autowaze.world.wire_columns import (
    MAX_WINDOW_S,
    bounded_count,
    decode_features,
    decode_ground,
    decode_instance_views,
    decode_instances,
    encode_features,
    encode_ground,
    encode_instance_views,
    encode_instances,
)
from autowaze.world.wire_rows import (
    decode_georeference,
    decode_traffic,
    decode_trajectory,
    encode_georeference,
    encode_traffic,
    encode_trajectory,
)

VERSION = 2
READABLE = (1, 2)
MAX_MESSAGE_BYTES = 1 << 20
"""A diff larger than this is refused unread; typical ones are 5 KB."""
MAX_BODY_BYTES = 4 << 20
"""What a diff may unpack to."""
MAX_MAP_BYTES = 1 << 30
MAX_REMOVED = 1 << 16
MAX_MAP_FEATURES = 1 << 24

_ZSTD_LEVEL = 12


def encode_diff(diff: SemanticMapDiff) -> bytes:
    """The bytes of a diff; the same diff gives the same bytes."""
    message = pb.SemanticMapDiff(
        session=diff.session,
        sequence=diff.sequence,
        start=diff.start,
        end=diff.end,
        map_version=diff.map_version,
        georeference=encode_georeference(diff.georeference),
        frames=diff.frames,
        localized_frames=diff.localized_frames,
        position_sigma_mm=round(diff.position_sigma_m * 1000),
        new=encode_features(diff.new, diff.new.instance_key & np.uint64(MAX_INSTANCE - 1), diff.start),
        removed_count=len(diff.removed),
        removed=pack_integers(diff.removed.astype(np.int64), delta=True),
        instances=encode_instances(diff.instances),
        ground=encode_ground(diff.ground),
        traffic=encode_traffic(diff.traffic),
        trajectory=encode_trajectory(diff.trajectory, diff.start),
    )
    data = _seal(message.SerializeToString(deterministic=True))
    if len(data) > MAX_MESSAGE_BYTES:
        raise WireError(f"diff of {len(data)} bytes, {MAX_MESSAGE_BYTES} is the limit: use shorter windows")
    return data


def decode_diff(data: bytes) -> SemanticMapDiff:
    """The diff in these bytes.

    Raises:
        WireError: they are no diff, of an unknown version, or a value is out of range.
    """
    message = pb.SemanticMapDiff()
    _parse(message, body_of(data))
    _check_header(message)
    new, instance = decode_features(message.new, MAX_FEATURES_PER_DIFF, MAX_INSTANCE - 1, message.start)
    new.id = feature_ids(message.session, message.sequence, len(new))
    new.instance_key = instance_keys(message.session, instance)
    return SemanticMapDiff(
        session=message.session,
        sequence=message.sequence,
        start=message.start,
        end=message.end,
        map_version=message.map_version,
        georeference=decode_georeference(message),
        frames=message.frames,
        localized_frames=message.localized_frames,
        position_sigma_m=message.position_sigma_mm / 1000,
        new=new,
        removed=_decode_removed(message.removed, message.removed_count, MAX_REMOVED),
        instances=decode_instances(message.instances),
        ground=decode_ground(message.ground),
        traffic=decode_traffic(message.traffic),
        trajectory=decode_trajectory(message.trajectory, message.start),
    )


def body_of(data: bytes) -> bytes:
    """The message in the envelope of a diff, as protobuf; raises `WireError` as `decode_diff` does."""
    return _open(data, MAX_MESSAGE_BYTES, MAX_BODY_BYTES)


def encode_map(feature_map: FeatureMap) -> bytes:
    """The bytes of a stored map."""
    return _seal(_encode_map(feature_map).SerializeToString(deterministic=True))


def decode_map(data: bytes) -> FeatureMap:
    """The stored map in these bytes; raises `WireError` as `decode_diff` does."""
    message = pb.FeatureMap()
    _parse(message, _open(data, MAX_MAP_BYTES, MAX_MAP_BYTES))
    return _decode_map(message)


def encode_map_update(update: MapUpdate) -> bytes:
    """The bytes of a map update."""
    added = update.added[np.argsort(update.added.id, kind="stable")]
    message = pb.MapUpdate(
        from_version=update.from_version,
        added=_encode_map(FeatureMap(added, update.georeference, update.to_version)),
        removed_count=len(update.removed),
        removed=pack_integers(update.removed.astype(np.int64), delta=True),
    )
    return _seal(message.SerializeToString(deterministic=True))


def decode_map_update(data: bytes, most_bytes: int = MAX_MAP_BYTES, most_features: int = MAX_MAP_FEATURES) -> MapUpdate:
    """The map update in these bytes, if it unpacks to no more than this; raises `WireError` as `decode_diff` does."""
    message = pb.MapUpdate()
    _parse(message, _open(data, most_bytes, most_bytes))
    added = _decode_map(message.added, most_features)
    removed = _decode_removed(message.removed, message.removed_count, most_features)
    if message.from_version > added.version:
        raise WireError("from_version: the update leads backwards")
    return MapUpdate(message.from_version, added.version, added.features, removed, added.georeference)


def _encode_map(feature_map: FeatureMap) -> pb.FeatureMap:
    features = feature_map.features
    epoch = float(np.floor(features.first_seen.min())) if len(features) else 0.0
    keys, index = np.unique(features.instance_key, return_inverse=True)
    if len(keys) == 0 or keys[0] != 0:
        keys, index = np.concatenate([[np.uint64(0)], keys]), index + 1
    return pb.FeatureMap(
        version=feature_map.version,
        epoch=epoch,
        georeference=encode_georeference(feature_map.georeference),
        features=encode_features(features, index, epoch),
        id=pack_integers(features.id.astype(np.int64), delta=True),
        instance_count=len(keys),
        instance_keys=pack_integers(keys.astype(np.int64), delta=True),
        instance_views=encode_instance_views(features, index, len(keys)),
    )


def _decode_map(message: pb.FeatureMap, most_features: int = MAX_MAP_FEATURES) -> FeatureMap:
    if not math.isfinite(message.epoch):
        raise WireError("epoch: not a time")
    key_count = bounded_count(message.instance_count, most_features + 1, "instance_keys")
    keys = unpack_integers(message.instance_keys, key_count, 0, (1 << 63) - 1, "instance_keys").astype(np.uint64)
    features, index = decode_features(message.features, most_features, max(key_count - 1, 0), message.epoch)
    features.id = unpack_integers(message.id, len(features), 1, (1 << 63) - 1, "id").astype(np.uint64)
    if (np.diff(features.id.astype(np.int64)) <= 0).any():
        raise WireError("id: ids are not in ascending order")
    features.instance_key = keys[index] if len(features) else np.zeros(0, np.uint64)
    decode_instance_views(message.instance_views, features, index, key_count)
    return FeatureMap(features, decode_georeference(message), message.version)


def _decode_removed(packed: bytes, count: int, most: int) -> NDArray[np.uint64]:
    removed = unpack_integers(packed, bounded_count(count, most, "removed"), 1, (1 << 63) - 1, "removed")
    if (np.diff(removed) <= 0).any():
        raise WireError("removed: ids are not in ascending order")
    return removed.astype(np.uint64)


def _seal(body: bytes) -> bytes:
    packed = zstandard.ZstdCompressor(level=_ZSTD_LEVEL, write_content_size=True).compress(body)
    if len(packed) < len(body):
        return pb.Envelope(version=VERSION, body=packed).SerializeToString(deterministic=True)
    return pb.Envelope(version=VERSION, plain=body).SerializeToString(deterministic=True)


def _open(data: bytes, max_bytes: int, max_body: int) -> bytes:
    if len(data) > max_bytes:
        raise WireError(f"message of {len(data)} bytes, {max_bytes} is the limit")
    envelope = pb.Envelope()
    _parse(envelope, data)
    if envelope.version not in READABLE:
        raise WireError(f"wire format version {envelope.version}, this reader knows {READABLE[0]} to {VERSION}")
    if envelope.plain:
        if envelope.body or len(envelope.plain) > max_body:
            raise WireError(f"plain body of {len(envelope.plain)} bytes, {max_body} is the limit, beside a packed one")
        return envelope.plain
    try:
        size = zstandard.frame_content_size(envelope.body)
        if not 0 <= size <= max_body:
            raise WireError(f"body unpacks to {size} bytes, {max_body} is the limit")
        decompressor = zstandard.ZstdDecompressor(max_window_size=max(max_body, 1 << 23))
        return decompressor.decompress(envelope.body, max_output_size=size)
    except zstandard.ZstdError as error:
        raise WireError(f"body is no zstd frame: {error}") from error


def _parse(message: pb.Envelope | pb.SemanticMapDiff | pb.FeatureMap | pb.MapUpdate, data: bytes) -> None:
    try:
        message.ParseFromString(data)
    except DecodeError as error:
        raise WireError(f"not a {type(message).__name__} message: {error}") from error


def _check_header(message: pb.SemanticMapDiff) -> None:
    if message.session >= MAX_SESSION or message.sequence >= MAX_SEQUENCE:
        raise WireError("session or sequence out of range")
    if not (0 <= message.start <= message.end <= message.start + MAX_WINDOW_S and message.end < 1e11):
        raise WireError("start and end are no time window of at most an hour")
    if message.localized_frames > message.frames:
        raise WireError("more localized frames than frames")
    if message.map_version >= 1 << 63:
        raise WireError("map_version out of range")
