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
from autowaze.world.raster_codec import BLOCK, MAX_SQUARES, pack_classes, unpack_classes

MAX_WINDOW_S = 3600.0
_MAX_INSTANCES = 1 << 12
_MAX_TRAJECTORY_POINTS = 1 << 12
_MAX_COORDINATE_CM = 20_000_000  # 200 km: beyond that a tangent plane is no map
_MAX_CELL = _MAX_COORDINATE_CM // 25
_MAX_SPEED_CM_S = 10_000
_DISTANCE_UNIT_M, _STEPS_PER_OCTAVE = 0.25, 16
_LABELS = max(ClassLabel)


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
    position = np.stack(
        [
            unpack_integers(data, n, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM, "position")
            for data in (message.x, message.y, message.z)
        ],
        axis=1,
    )
    described = unpack_bits(message.described, n, "described")
    d = int(described.sum())
    if len(message.descriptor) != d * DESCRIPTOR_BYTES:
        raise WireError(f"descriptor: {len(message.descriptor)} bytes do not hold {d} descriptors")
    features = MapFeatures(
        id=np.zeros(n, np.uint64),
        position=position / 100.0,
        descriptor=np.zeros((n, DESCRIPTOR_BYTES), np.uint8),
        normal=np.zeros((n, 3), np.float32),
        min_distance=np.zeros(n, np.float32),
        max_distance=np.zeros(n, np.float32),
        label=unpack_integers(message.label, n, 0, _LABELS, "label").astype(np.uint8),
        instance_key=np.zeros(n, np.uint64),
        first_seen=epoch + _decode_tenths(message.first_seen, n, "first_seen"),
        last_seen=epoch + _decode_tenths(message.last_seen, n, "last_seen"),
        observations=unpack_integers(message.observations, n, 0, 0xFFFF, "observations").astype(np.uint16),
    )
    features.descriptor[described] = np.frombuffer(message.descriptor, np.uint8).reshape(DESCRIPTOR_BYTES, d).T
    features.normal[described] = unpack_normals(message.normal, d, "normal")
    features.min_distance[described] = _decode_distance(message.min_distance, d, "min_distance")
    features.max_distance[described] = _decode_distance(message.max_distance, d, "max_distance")
    return features, unpack_integers(message.instance, n, 0, max_instance, "instance")


def _decode_tenths(data: bytes, count: int, what: str) -> NDArray[np.float64]:
    """Checked features of a message; raises `WireError`."""
    return unpack_integers(data, count, -(1 << 40), 1 << 40, what) / 10.0


def _log_distance(metres: NDArray[np.floating]) -> NDArray[np.int64]:
    steps = np.round(_STEPS_PER_OCTAVE * np.log2(np.maximum(metres, 1e-3) / _DISTANCE_UNIT_M))
    return np.asarray(np.clip(steps, 0, 255), dtype=np.int64)


def _decode_distance(data: bytes, count: int, what: str) -> NDArray[np.float32]:
    steps = unpack_integers(data, count, 0, 255, what)
    return np.asarray(_DISTANCE_UNIT_M * 2.0 ** (steps / _STEPS_PER_OCTAVE), dtype=np.float32)


def encode_instances(instances: InstanceSummaries) -> pb.Instances:
    """Columns of instances."""
    bearing = np.arctan2(instances.view_direction[:, 0], instances.view_direction[:, 1])
    return pb.Instances(
        count=len(instances),
        id=pack_integers(instances.id, delta=True),
        label=pack_integers(instances.label),
        confidence=pack_integers(np.round(instances.confidence * 255)),
        view_direction=pack_integers(np.round(bearing / (2 * np.pi) * 256).astype(np.int64) % 256),
        frames=pack_integers(instances.frames),
    )


def decode_instances(message: pb.Instances) -> InstanceSummaries:
    """Checked instances of a message; raises `WireError`."""
    n = bounded_count(message.count, _MAX_INSTANCES, "instances")
    bearing = unpack_integers(message.view_direction, n, 0, 255, "view_direction") * (2 * np.pi / 256)
    return InstanceSummaries(
        id=unpack_integers(message.id, n, 1, MAX_INSTANCE - 1, "instances.id").astype(np.int32),
        label=unpack_integers(message.label, n, 0, _LABELS, "instances.label").astype(np.uint8),
        confidence=(unpack_integers(message.confidence, n, 0, 255, "confidence") / 255).astype(np.float32),
        view_direction=np.stack([np.sin(bearing), np.cos(bearing)], axis=1).astype(np.float32),
        frames=unpack_integers(message.frames, n, 0, 0xFFFF, "instances.frames").astype(np.uint16),
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
    grid = unpack_classes(message.cells, message.rows * BLOCK, message.columns * BLOCK, "ground")
    iy, ix = np.nonzero(grid)
    obstacle = grid[iy, ix] > 1
    votes = (~obstacle).astype(np.uint16), obstacle.astype(np.uint16)
    return GroundCells((ix + x).astype(np.int32), (iy + y).astype(np.int32), *votes)


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
    position = [
        unpack_integers(c, n, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM, "traffic position")
        for c in (message.x, message.y)
    ]
    velocity = [unpack_integers(c, n, -_MAX_SPEED_CM_S, _MAX_SPEED_CM_S, "velocity") for c in (message.vx, message.vy)]
    return Traffic(
        id=unpack_integers(message.id, n, 1, MAX_INSTANCE - 1, "traffic.id").astype(np.int32),
        label=unpack_integers(message.label, n, 0, _LABELS, "traffic.label").astype(np.uint8),
        position=(np.stack(position, axis=1) / 100).astype(np.float32),
        velocity=(np.stack(velocity, axis=1) / 100).astype(np.float32),
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
    position = [
        unpack_integers(column, n, -_MAX_COORDINATE_CM, _MAX_COORDINATE_CM, "trajectory position")
        for column in (message.x, message.y, message.z)
    ]
    window_ms = int(MAX_WINDOW_S * 1000)
    heading = unpack_integers(message.heading, n, 0, 65535, "heading") * (2 * np.pi / 65536)
    return Trajectory(
        time=start + unpack_integers(message.time, n, -window_ms, window_ms, "trajectory.time") / 1000,
        position=np.stack(position, axis=1) / 100,
        heading=np.where(heading > np.pi, heading - 2 * np.pi, heading).astype(np.float32),
    )
