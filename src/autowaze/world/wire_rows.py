"""What comes in few rows: the car's path, moving objects, the origin of the map frame.

A row's values hardly differ from what the rows before it foretell, so second differences between rows travel, each in
as few bytes as it needs. Messages of version 1 hold columns instead (`wire_columns`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world import wire_columns as v1
from autowaze.world import wire_pb2 as pb
from autowaze.world.errors import AutowazeError, WireError
from autowaze.world.georeference import Georeference
from autowaze.world.identity import MAX_INSTANCE
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import Traffic, Trajectory
from autowaze.world.wire_columns import MAX_WINDOW_S, bounded_count

_MAX_ROWS = 1 << 12
_MAX_COORDINATE_M = 200_000
_HEADINGS = 1024
_BYTES_PER_VALUE = 9
_WINDOW_MS = int(MAX_WINDOW_S * 1000)
_PATH_BOUNDS = np.array(
    [(-_WINDOW_MS, _WINDOW_MS), *[(-100 * _MAX_COORDINATE_M, 100 * _MAX_COORDINATE_M)] * 3, (0, _HEADINGS - 1)]
)
_TRAFFIC_BOUNDS = np.array(
    [
        (1, MAX_INSTANCE - 1),
        (0, max(ClassLabel)),
        *[(-10 * _MAX_COORDINATE_M, 10 * _MAX_COORDINATE_M)] * 2,
        *[(-1000, 1000)] * 2,
    ]
)


def encode_trajectory(trajectory: Trajectory, start: float) -> pb.Trajectory:
    """Rows of milliseconds after the start, centimetres, and 1/1024 turns."""
    if len(trajectory) == 0:
        return pb.Trajectory()
    heading = np.round(trajectory.heading / (2 * np.pi) * _HEADINGS) % _HEADINGS
    table = np.column_stack([(trajectory.time - start) * 1000, trajectory.position * 100, heading])
    return pb.Trajectory(count=len(trajectory), rows=pack_rows(table, order=2))


def decode_trajectory(message: pb.Trajectory, start: float) -> Trajectory:
    """Checked trajectory of a message; raises `WireError`."""
    if not message.rows:
        return v1.decode_trajectory(message, start)
    count = bounded_count(message.count, _MAX_ROWS, "trajectory")
    table = unpack_rows(message.rows, count, _PATH_BOUNDS, 2, "trajectory")
    heading = table[:, 4] * (2 * np.pi / _HEADINGS)
    return Trajectory(
        time=start + table[:, 0] / 1000,
        position=table[:, 1:4] / 100,
        heading=np.where(heading > np.pi, heading - 2 * np.pi, heading).astype(np.float32),
    )


def encode_traffic(traffic: Traffic) -> pb.Traffic:
    """Rows of id, label, decimetres, and decimetres per second."""
    if len(traffic) == 0:
        return pb.Traffic()
    velocity = np.clip(np.round(traffic.velocity * 10.0), *_TRAFFIC_BOUNDS[-1])
    table = np.column_stack([traffic.id, traffic.label, np.round(traffic.position * 10.0), velocity])
    return pb.Traffic(count=len(traffic), rows=pack_rows(table, order=1))


def decode_traffic(message: pb.Traffic) -> Traffic:
    """Checked traffic of a message; raises `WireError`."""
    if not message.rows:
        return v1.decode_traffic(message)
    count = bounded_count(message.count, _MAX_ROWS, "traffic")
    table = unpack_rows(message.rows, count, _TRAFFIC_BOUNDS, 1, "traffic")
    return Traffic(
        id=table[:, 0].astype(np.int32),
        label=table[:, 1].astype(np.uint8),
        position=(table[:, 2:4] / 10).astype(np.float32),
        velocity=(table[:, 4:6] / 10).astype(np.float32),
    )


def encode_georeference(georeference: Georeference | None) -> pb.Georeference | None:
    """In whole 1e-7 degrees and centimetres where that is exact, else in full."""
    if georeference is None:
        return None
    g = georeference
    lat_e7, lon_e7, cm = round(g.lat_deg * 1e7), round(g.lon_deg * 1e7), round(g.altitude_m * 100)
    if (lat_e7 / 1e7, lon_e7 / 1e7, cm / 100) == (g.lat_deg, g.lon_deg, g.altitude_m):
        return pb.Georeference(lat_e7=lat_e7, lon_e7=lon_e7, altitude_cm=cm)
    return pb.Georeference(lat_deg=g.lat_deg, lon_deg=g.lon_deg, altitude_m=g.altitude_m)


def decode_georeference(message: pb.SemanticMapDiff | pb.FeatureMap) -> Georeference | None:
    """Checked georeference of a message, None if it states none; raises `WireError`."""
    if not message.HasField("georeference"):
        return None
    g = message.georeference
    try:
        return Georeference(
            g.lat_deg or g.lat_e7 / 1e7, g.lon_deg or g.lon_e7 / 1e7, g.altitude_m or g.altitude_cm / 100
        )
    except AutowazeError as error:
        raise WireError(str(error)) from error


def pack_rows(table: NDArray[np.floating], order: int) -> bytes:
    """Whole numbers (N, K) row by row, in differences of this order to the rows before.

    Each is zigzag-coded into groups of seven bits, the lowest first; all but the last have the highest bit set.
    """
    values = np.round(table).astype(np.int64)
    for _ in range(order):
        values = np.diff(values, axis=0, prepend=0)
    out = bytearray()
    for zigzag in ((values << 1) ^ (values >> 63)).ravel().tolist():
        rest = zigzag
        while rest > 0x7F:
            out.append(rest & 0x7F | 0x80)
            rest >>= 7
        out.append(rest)
    return bytes(out)


def unpack_rows(data: bytes, count: int, bounds: NDArray[np.int64], order: int, what: str) -> NDArray[np.int64]:
    """The whole numbers (count, K) of rows, within bounds (K, 2).

    Raises:
        WireError: the bytes are not of so many rows, or a value lies outside its bounds.
    """
    wanted = count * len(bounds)
    if not wanted <= len(data) <= wanted * _BYTES_PER_VALUE:
        raise WireError(f"{what}: {len(data)} bytes do not hold {count} rows")
    numbers, number, shift = [], 0, 0
    for byte in data:
        number |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            numbers.append((number >> 1) ^ -(number & 1))
            number = shift = 0
        elif shift >= 7 * _BYTES_PER_VALUE:
            raise WireError(f"{what}: a value of more than {_BYTES_PER_VALUE} bytes")
    if len(numbers) != wanted or shift:
        raise WireError(f"{what}: {len(data)} bytes do not hold {count} rows")
    values = np.array(numbers, dtype=np.int64).reshape(count, len(bounds))
    for _ in range(order):
        values = np.cumsum(values, axis=0)  # wraps, as sums of 64 bits do
    if ((values < bounds[:, 0]) | (values > bounds[:, 1])).any():
        raise WireError(f"{what}: a value lies outside its bounds")
    return values
