"""The parts of a message: features, instances, ground, traffic and trajectory as packed columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world import wire_pb2 as pb
from autowaze.world.column_codec import (
    pack_bits,
    pack_integers,
    pack_normals,
    unpack_bits,
    unpack_columns,
    unpack_integers,
    unpack_normals,
)
from autowaze.world.errors import WireError
from autowaze.world.feature_map import MapFeatures
from autowaze.world.features import DESCRIPTOR_BYTES
from autowaze.world.ground import GroundCells
from autowaze.world.identity import MAX_INSTANCE
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import InstanceSummaries, Traffic, Trajectory
from autowaze.world.raster_codec import BLOCK, MAX_SQUARES, pack_classes, unpack_cells

MAX_WINDOW_S = 3600.0
_MAX_INSTANCES = 1 << 12
_MAX_TRAJECTORY_POINTS = 1 << 12
_MAX_COORDINATE_CM = 20_000_000  # 200 km: beyond that a tangent plane is no map
_MAX_CELL = _MAX_COORDINATE_CM // 25
_MAX_SPEED_CM_S = 10_000
_DISTANCE_UNIT_M, _STEPS_PER_OCTAVE = 0.25, 16
_LABELS = max(ClassLabel)
_TENTHS = (-(1 << 40), 1 << 40)
_DISTANCES_M = (_DISTANCE_UNIT_M * 2.0 ** (np.arange(256) / _STEPS_PER_OCTAVE)).astype(np.float32)
_BEARINGS = np.arange(256) * (2 * np.pi / 256)
_VIEW_DIRECTIONS = np.stack([np.sin(_BEARINGS), np.cos(_BEARINGS)], axis=1).astype(np.float32)


def bounded_count(count: int, limit: int, what: str) -> int:
    """The count, or a `WireError` beyond the limit."""
    if count > limit:
        raise WireError(f"{what}: {count} values, {limit} is the limit")
    return count


def _centimetres(values: NDArray[np.floating]) -> NDArray[np.int64]:
    return np.asarray(np.round(np.asarray(values) * 100), dtype=np.int64)


def encode_features(features: MapFeatures, instance: NDArray[np.integer], epoch: float) -> pb.Features:
    """Columns of features."""
    described = features.described
    rows = features[described]
    x, y, z = _centimetres(features.position).T
    return pb.Features(
        count=len(features),
        x=pack_integers(x, delta=True),
        y=pack_integers(y, delta=True),
        z=pack_integers(z, delta=True),
        label=pack_integers(features.label),
        instance=pack_integers(instance.astype(np.int64), delta=True),
        first_seen=pack_integers(np.round((features.first_seen - epoch) * 10), delta=True),
        last_seen=pack_integers(np.round((features.last_seen - epoch) * 10), delta=True),
        observations=pack_integers(features.observations),
        described=pack_bits(described),
        normal=pack_normals(rows.normal),
        min_distance=pack_integers(_log_distance(rows.min_distance)),
        max_distance=pack_integers(_log_distance(rows.max_distance)),
        descriptor=rows.descriptor.T.tobytes(),
    )


def decode_features(
    message: pb.Features, limit: int, max_instance: int, epoch: float
) -> tuple[MapFeatures, NDArray[np.int64]]:
    """Features without id and instance key, and their instance column."""
    n = bounded_count(message.count, limit, "features")
    table = unpack_columns(
        (
            ("position", message.x, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM),
            ("position", message.y, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM),
            ("position", message.z, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM),
            ("label", message.label, 0, _LABELS),
            ("first_seen", message.first_seen, *_TENTHS),
            ("last_seen", message.last_seen, *_TENTHS),
            ("observations", message.observations, 0, 0xFFFF),
            ("instance", message.instance, 0, max_instance),
        ),
        n,
    )
    described = unpack_bits(message.described, n, "described")
    d = int(np.count_nonzero(described))
    if len(message.descriptor) != d * DESCRIPTOR_BYTES:
        raise WireError(f"descriptor: {len(message.descriptor)} bytes do not hold {d} descriptors")
    steps = unpack_columns(
        (("min_distance", message.min_distance, 0, 255), ("max_distance", message.max_distance, 0, 255)), d
    )
    normal = unpack_normals(message.normal, d, "normal")
    seen = epoch + table[4:6] / 10.0
    features = MapFeatures(
        id=np.zeros(n, np.uint64),
        position=np.ascontiguousarray(table[:3].T) / 100.0,
        descriptor=np.zeros((n, DESCRIPTOR_BYTES), np.uint8),
        normal=np.zeros((n, 3), np.float32),
        min_distance=np.zeros(n, np.float32),
        max_distance=np.zeros(n, np.float32),
        label=table[3].astype(np.uint8),
        instance_key=np.zeros(n, np.uint64),
        first_seen=seen[0],
        last_seen=seen[1],
        observations=table[6].astype(np.uint16),
    )
    if d:
        rows = np.flatnonzero(described)
        features.descriptor[rows] = np.frombuffer(message.descriptor, np.uint8).reshape(DESCRIPTOR_BYTES, d).T
        features.normal[rows] = normal
        features.min_distance[rows], features.max_distance[rows] = _DISTANCES_M[steps]
    return features, table[7]


def _log_distance(metres: NDArray[np.floating]) -> NDArray[np.int64]:
    steps = np.round(_STEPS_PER_OCTAVE * np.log2(np.maximum(metres, 1e-3) / _DISTANCE_UNIT_M))
    return np.asarray(np.clip(steps, 0, 255), dtype=np.int64)


def encode_instance_views(features: MapFeatures, instance: NDArray[np.integer], count: int) -> bytes:
    """From where each of a map's instances was seen, as the normals of its features without descriptor say."""
    codes = np.zeros(count, np.int64)
    rows = np.flatnonzero(~features.described & (instance > 0) & features.normal[:, :2].any(axis=1))
    codes[instance[rows]] = 1 + _bearing_steps(-features.normal[rows, :2])
    return pack_integers(codes) if codes.any() else b""


def decode_instance_views(data: bytes, features: MapFeatures, instance: NDArray[np.int64], count: int) -> None:
    """Set the normals of features without descriptor as their instances (N,) were seen; raises `WireError`."""
    if not data:
        return
    codes = unpack_integers(data, count, 0, 256, "instance_views")[instance]
    rows = np.flatnonzero(~features.described & (instance > 0) & (codes > 0))
    features.normal[rows, :2] = -_VIEW_DIRECTIONS[codes[rows] - 1]


def _bearing_steps(direction: NDArray[np.floating]) -> NDArray[np.int64]:
    """Bearings of vectors (N, 2) in 256ths of a turn."""
    bearing = np.arctan2(direction[:, 0], direction[:, 1])
    return np.asarray(np.round(bearing / (2 * np.pi) * 256), dtype=np.int64) % 256


def encode_instances(instances: InstanceSummaries) -> pb.Instances:
    """Columns of instances."""
    return pb.Instances(
        count=len(instances),
        id=pack_integers(instances.id, delta=True),
        label=pack_integers(instances.label),
        confidence=pack_integers(np.round(instances.confidence * 255)),
        view_direction=pack_integers(_bearing_steps(instances.view_direction)),
        frames=pack_integers(instances.frames),
    )


def decode_instances(message: pb.Instances) -> InstanceSummaries:
    """Checked instances of a message; raises `WireError`."""
    n = bounded_count(message.count, _MAX_INSTANCES, "instances")
    table = unpack_columns(
        (
            ("instances.id", message.id, 1, MAX_INSTANCE - 1),
            ("instances.label", message.label, 0, _LABELS),
            ("confidence", message.confidence, 0, 255),
            ("view_direction", message.view_direction, 0, 255),
            ("instances.frames", message.frames, 0, 0xFFFF),
        ),
        n,
    )
    return InstanceSummaries(
        id=table[0].astype(np.int32),
        label=table[1].astype(np.uint8),
        confidence=(table[2] / 255).astype(np.float32),
        view_direction=_VIEW_DIRECTIONS[table[3]],
        frames=table[4].astype(np.uint16),
    )


def encode_ground(ground: GroundCells) -> pb.Ground:
    """The cells as a grid of classes: of each only which it was in more frames, free or obstacle, travels."""
    if len(ground) == 0:
        return pb.Ground()
    x, y = (int(column.min()) // BLOCK for column in (ground.ix, ground.iy))
    columns, rows = int(ground.ix.max()) // BLOCK + 1 - x, int(ground.iy.max()) // BLOCK + 1 - y
    if columns * rows > MAX_SQUARES:
        raise WireError(f"ground of {columns} by {rows} squares, {MAX_SQUARES} is the limit: use shorter windows")
    grid = np.zeros((rows * BLOCK, columns * BLOCK), np.uint8)
    grid[ground.iy - y * BLOCK, ground.ix - x * BLOCK] = np.where(ground.obstacle >= np.maximum(ground.free, 1), 2, 1)
    return pb.Ground(x=x, y=y, columns=columns, rows=rows, cells=pack_classes(grid))


def decode_ground(message: pb.Ground) -> GroundCells:
    """Checked ground of a message, one vote per cell; raises `WireError`."""
    if max(message.columns, message.rows) > MAX_SQUARES:  # before they are multiplied
        raise WireError(f"ground: {message.columns} by {message.rows} squares are no grid")
    x, y = message.x * BLOCK, message.y * BLOCK
    if not (abs(x) <= _MAX_CELL and abs(y) <= _MAX_CELL):
        raise WireError("ground: it lies outside of the map frame")
    cells = unpack_cells(message.cells, message.rows * BLOCK, message.columns * BLOCK, "ground")
    return GroundCells(cells.ix + np.int32(x), cells.iy + np.int32(y), cells.free, cells.obstacle)


def encode_traffic(traffic: Traffic) -> pb.Traffic:
    """Columns of traffic."""
    x, y = _centimetres(traffic.position).T
    vx, vy = np.clip(_centimetres(traffic.velocity), -_MAX_SPEED_CM_S, _MAX_SPEED_CM_S).T
    return pb.Traffic(
        count=len(traffic),
        id=pack_integers(traffic.id, delta=True),
        label=pack_integers(traffic.label),
        x=pack_integers(x, delta=True),
        y=pack_integers(y, delta=True),
        vx=pack_integers(vx),
        vy=pack_integers(vy),
    )


def decode_traffic(message: pb.Traffic) -> Traffic:
    """Checked traffic of a message; raises `WireError`."""
    n = bounded_count(message.count, _MAX_INSTANCES, "traffic")
    table = unpack_columns(
        (
            ("traffic.id", message.id, 1, MAX_INSTANCE - 1),
            ("traffic.label", message.label, 0, _LABELS),
            ("traffic position", message.x, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM),
            ("traffic position", message.y, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM),
            ("velocity", message.vx, -_MAX_SPEED_CM_S, _MAX_SPEED_CM_S),
            ("velocity", message.vy, -_MAX_SPEED_CM_S, _MAX_SPEED_CM_S),
        ),
        n,
    )
    return Traffic(
        id=table[0].astype(np.int32),
        label=table[1].astype(np.uint8),
        position=(table[2:4].T / 100).astype(np.float32),
        velocity=(table[4:6].T / 100).astype(np.float32),
    )


def encode_trajectory(trajectory: Trajectory, start: float) -> pb.Trajectory:
    """Columns of trajectory."""
    x, y, z = _centimetres(trajectory.position).T
    return pb.Trajectory(
        count=len(trajectory),
        time=pack_integers(np.round((trajectory.time - start) * 1000), delta=True),
        x=pack_integers(x, delta=True),
        y=pack_integers(y, delta=True),
        z=pack_integers(z, delta=True),
        heading=pack_integers(np.round(trajectory.heading / (2 * np.pi) * 65536).astype(np.int64) % 65536, delta=True),
    )


def decode_trajectory(message: pb.Trajectory, start: float) -> Trajectory:
    """Checked trajectory of a message; raises `WireError`."""
    n = bounded_count(message.count, _MAX_TRAJECTORY_POINTS, "trajectory")
    window_ms = int(MAX_WINDOW_S * 1000)
    table = unpack_columns(
        (
            ("trajectory position", message.x, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM),
            ("trajectory position", message.y, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM),
            ("trajectory position", message.z, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM),
            ("trajectory.time", message.time, -window_ms, window_ms),
            ("heading", message.heading, 0, 65535),
        ),
        n,
    )
    heading = table[4] * (2 * np.pi / 65536)
    return Trajectory(
        time=start + table[3] / 1000,
        position=np.ascontiguousarray(table[:3].T) / 100,
        heading=np.where(heading > np.pi, heading - 2 * np.pi, heading).astype(np.float32),
    )
