"""A diff survives the wire to the stated precision; a reader survives any bytes."""

import tracemalloc

import numpy as np
import pytest
import zstandard
from diffs import random_diff
from hypothesis import given, settings
from hypothesis import strategies as st

from autowaze.world import wire_columns
from autowaze.world import wire_pb2 as pb
from autowaze.world.column_codec import pack_integers, pack_normals, unpack_integers, unpack_normals
from autowaze.world.errors import WireError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.georeference import Georeference
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.wire import MAX_BODY_BYTES, _decode_map, body_of, decode_diff, decode_map, encode_diff, encode_map
from autowaze.world.wire_rows import pack_rows, unpack_rows

int64s = st.lists(st.integers(-(2**61), 2**61), max_size=300)


@given(int64s, st.booleans())
def test_integers_survive_a_column_exactly(values: list[int], delta: bool) -> None:
    data = pack_integers(np.array(values, dtype=np.int64), delta)
    assert unpack_integers(data, len(values), -(2**61), 2**61, "column").tolist() == values


@given(st.integers(0, 2**32 - 1))
def test_unit_vectors_survive_within_a_degree(seed: int) -> None:
    normals = np.random.default_rng(seed).normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    back = unpack_normals(pack_normals(normals), 50, "normal")
    assert np.degrees(np.arccos(np.clip((normals * back).sum(axis=1), -1, 1))).max() < 1.0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 400), st.integers(0, 400))
def test_a_diff_survives_the_wire(seed: int, features: int, cells: int) -> None:
    sent = random_diff(seed, features, cells)
    received = decode_diff(encode_diff(sent))
    assert (received.key, received.frames, received.localized_frames) == (sent.key, sent.frames, sent.localized_frames)
    assert received.georeference == sent.georeference
    np.testing.assert_allclose(received.new.position, sent.new.position, atol=0.00501)
    for column in ("id", "descriptor", "label", "instance_key", "observations"):
        np.testing.assert_array_equal(getattr(received.new, column), getattr(sent.new, column))
    np.testing.assert_allclose(received.new.first_seen, sent.new.first_seen, atol=0.051)
    np.testing.assert_allclose(received.new.max_distance, sent.new.max_distance, rtol=0.03)
    np.testing.assert_array_equal(received.removed, sent.removed)
    np.testing.assert_array_equal(received.instances.id, sent.instances.id)
    np.testing.assert_allclose(received.instances.view_direction, sent.instances.view_direction, atol=0.02)
    order = np.lexsort((sent.ground.ix, sent.ground.iy))
    for column in ("ix", "iy", "free", "obstacle"):
        np.testing.assert_array_equal(getattr(received.ground, column), getattr(sent.ground, column)[order])
    np.testing.assert_allclose(received.traffic.position, sent.traffic.position, atol=0.0501)
    np.testing.assert_allclose(received.traffic.velocity, sent.traffic.velocity, atol=0.0501)
    np.testing.assert_allclose(received.trajectory.position, sent.trajectory.position, atol=0.00501)
    np.testing.assert_allclose(received.trajectory.time, sent.trajectory.time, atol=0.00051)
    np.testing.assert_allclose(received.trajectory.heading, sent.trajectory.heading, atol=0.0031)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_what_came_over_the_wire_goes_again_unchanged(seed: int) -> None:
    sent = random_diff(seed)
    sent.new.normal[:] = [0, 0, 1]  # unit vectors on the fold of the octahedron may move by one step
    once = encode_diff(sent)
    assert encode_diff(decode_diff(once)) == once


def test_an_empty_diff_takes_few_bytes() -> None:
    data = encode_diff(SemanticMapDiff(session=1, sequence=0, start=0.0, end=5.0))
    assert len(data) < 80
    assert len(decode_diff(data).new) == 0


def test_a_map_survives_its_file_format() -> None:
    features = random_diff(3, features=5000 // 2).new
    features.instance_key[::7] = (99 << 24) | 5  # of another session
    received = decode_map(encode_map(FeatureMap(features, Georeference(49.0, 8.4), version=12)))
    assert received.version == 12
    np.testing.assert_array_equal(received.features.instance_key, features.instance_key)
    np.testing.assert_array_equal(received.features.id, features.id)
    np.testing.assert_array_equal(received.features.descriptor, features.descriptor)
    np.testing.assert_allclose(received.features.position, features.position, atol=0.00501)


def test_a_map_file_tells_from_where_vehicles_were_seen() -> None:
    features = random_diff(3, features=300).new
    plain = ~features.described
    assert plain.any()
    angle = (features.instance_key[plain] % np.uint64(7)).astype(np.float64)
    features.normal[plain] = np.stack([np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)
    told = plain & (features.instance_key > 0)
    received = decode_map(encode_map(FeatureMap(features)))
    np.testing.assert_allclose(received.features.normal[told], features.normal[told], atol=0.0125)
    message = pb.FeatureMap(instance_count=3, instance_keys=pack_integers([0, 5, 6]), instance_views=b"\x00\x00")
    with pytest.raises(WireError, match="instance_views"):
        _decode_map(message)


def test_a_newer_format_is_refused_by_its_number() -> None:
    envelope = pb.Envelope.FromString(encode_diff(random_diff(0)))
    envelope.version = 3
    with pytest.raises(WireError, match="version 3"):
        decode_diff(envelope.SerializeToString())


def test_diffs_of_version_1_are_read() -> None:
    sent = random_diff(5)
    message = pb.SemanticMapDiff.FromString(body_of(encode_diff(sent)))
    g = sent.georeference
    message.georeference.CopyFrom(pb.Georeference(lat_deg=g.lat_deg, lon_deg=g.lon_deg, altitude_m=g.altitude_m))
    message.trajectory.CopyFrom(wire_columns.encode_trajectory(sent.trajectory, sent.start))
    message.traffic.CopyFrom(wire_columns.encode_traffic(sent.traffic))
    received = decode_diff(_sealed(message.SerializeToString()))
    assert received.georeference == g
    np.testing.assert_allclose(received.traffic.velocity, sent.traffic.velocity, atol=0.0051)
    np.testing.assert_allclose(received.trajectory.heading, sent.trajectory.heading, atol=1e-4)
    np.testing.assert_allclose(received.trajectory.position, sent.trajectory.position, atol=0.00501)


@given(st.lists(st.tuples(*[st.integers(-(2**40), 2**40)] * 3), max_size=50), st.integers(0, 2))
def test_rows_survive_exactly(rows: list[tuple[int, ...]], order: int) -> None:
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    bounds = np.array([(-(2**40), 2**40)] * 3)
    assert unpack_rows(pack_rows(table, order), len(rows), bounds, order, "rows").tolist() == table.tolist()


@pytest.mark.parametrize("origin", [(49.0, 8.4, 113.0), (49.0123456, -8.4, 1.05), (1 / 3, 2 / 3, 1 / 7), (0, 0, 0)])
def test_a_georeference_survives_exactly(origin: tuple[float, float, float]) -> None:
    diff = SemanticMapDiff(1, 0, 0.0, 5.0, georeference=Georeference(*origin))
    assert decode_diff(encode_diff(diff)).georeference == diff.georeference


def test_a_decompression_bomb_is_refused_unopened() -> None:
    bomb = zstandard.ZstdCompressor().compress(bytes(MAX_BODY_BYTES + 1))
    with pytest.raises(WireError, match="unpacks to"):
        decode_diff(pb.Envelope(version=1, body=bomb).SerializeToString())


@pytest.mark.parametrize(
    ("field", "value"),
    [("sequence", 1 << 12), ("session", 1 << 39), ("end", float("nan")), ("start", -1.0), ("localized_frames", 51)],
)
def test_values_out_of_range_are_refused(field: str, value: float) -> None:
    message = pb.SemanticMapDiff.FromString(body_of(encode_diff(random_diff(0))))
    setattr(message, field, value)
    with pytest.raises(WireError):
        decode_diff(_sealed(message.SerializeToString()))


def test_a_reader_survives_100000_mutated_messages() -> None:
    """Half of the mutations hit the envelope, half the message inside, so that both layers are reached."""
    rng = np.random.default_rng(20261122)
    sealed = [encode_diff(random_diff(seed, features=20, cells=20)) for seed in range(8)]
    bodies = [body_of(data) for data in sealed]
    valid = 0
    for i in range(100_000):
        if i == 90_000:
            tracemalloc.start()  # slows everything down, so only for the last tenth
        data = _sealed(_mutated(bodies[i % 8], rng)) if i % 2 else _mutated(sealed[i % 8], rng)
        try:
            diff = decode_diff(data)
        except WireError:
            continue
        valid += 1
        assert np.isfinite(diff.new.position).all()
        assert len(diff.removed) < 1 << 16
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64 << 20
    assert valid > 1000  # else the mutations never got past the envelope


def _sealed(body: bytes) -> bytes:
    return pb.Envelope(version=1, body=zstandard.ZstdCompressor(level=1).compress(body)).SerializeToString()


def _mutated(data: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        position = int(rng.integers(0, len(out)))
        match int(rng.integers(0, 4)):
            case 0:
                out[position] = int(rng.integers(0, 256))
            case 1:
                out[position] ^= 1 << int(rng.integers(0, 8))
            case 2:
                del out[position : position + int(rng.integers(1, 9))]
            case 3:
                out[position:position] = rng.bytes(int(rng.integers(1, 9)))
        if not out:
            return b""
    return bytes(out)
