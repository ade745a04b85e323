"""The map is the same whatever the order and however often diffs arrive."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from street import features

from autowaze.cloud.grouping import group_by_instance
from autowaze.cloud.integration import MapState
from autowaze.cloud.snapshot import pack, unpack
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.identity import feature_ids
from autowaze.world.map_diff import SemanticMapDiff

SESSION = 7


def additions(sequence, count=5, instance=1):
    rng = np.random.default_rng(sequence)
    return SemanticMapDiff(
        SESSION,
        sequence,
        10.0 * sequence,
        10.0 * sequence + 5,
        new=features(SESSION, sequence, rng.random((count, 3)), [np.full(count, instance)], 10.0 * sequence),
    )


def removals(sequence, *ids):
    return SemanticMapDiff(SESSION, sequence, 0.0, 5.0, removed=np.array(sorted(ids), dtype=np.uint64))


def as_bytes(features: MapFeatures) -> bytes:
    return b"".join(getattr(features, f.name).tobytes() for f in fields(features))


@st.composite
def deliveries(draw):
    """Diffs that remove each other's features, and the same diffs shuffled with repetitions."""
    count = draw(st.integers(1, 6))
    diffs = []
    for sequence in range(count):
        of = draw(st.lists(st.tuples(st.integers(0, count), st.integers(0, 6)), max_size=8))
        removed = {int(feature_ids(SESSION, s, row + 1)[row]) for s, row in of}
        diffs.append(replace(additions(sequence), removed=np.array(sorted(removed), dtype=np.uint64)))
    order = draw(st.permutations(diffs + draw(st.lists(st.sampled_from(diffs), max_size=4))))
    return diffs, order


@given(deliveries())
@settings(max_examples=150, deadline=None)
def test_any_order_and_repetition_gives_the_same_map(delivery):
    diffs, order = delivery
    straight, shuffled = MapState(), MapState()
    for diff in diffs:
        straight.integrate(diff)
    for diff in order:
        shuffled.integrate(diff)
    assert as_bytes(straight.features) == as_bytes(shuffled.features)
    assert straight.version == shuffled.version == len(diffs)


@given(deliveries())
@settings(max_examples=50, deadline=None)
def test_changes_add_up_to_the_map(delivery):
    _, order = delivery
    state, carried = MapState(), {}
    for diff in order:
        change = state.integrate(diff)
        if change is None:
            continue
        assert not set(change.added.id.tolist()) & set(change.removed.tolist())
        for gone in change.removed.tolist():
            del carried[gone]
        carried.update(dict.fromkeys(change.added.id.tolist()))
    assert sorted(carried) == state.features.id.tolist()


def test_removal_that_overtakes_its_addition_holds():
    state = MapState()
    state.integrate(removals(9, *feature_ids(SESSION, 3, 2)))
    state.integrate(additions(3, count=5))
    assert state.features.id.tolist() == feature_ids(SESSION, 3, 5)[2:].tolist()


def test_base_map_features_can_be_removed():
    base = additions(0, count=4).new
    state = MapState(FeatureMap(base, version=12))
    change = state.integrate(removals(1, base.id[1]))
    assert change is not None
    assert change.removed.tolist() == [base.id[1]]
    assert change.instances.tolist() == [base.instance_key[1]]
    assert state.features.id.tolist() == base.id[[0, 2, 3]].tolist()
    assert state.version == 13


def test_vehicle_features_of_an_instance_come_from_all_windows():
    state = MapState()
    state.integrate(additions(0, count=3, instance=1))
    state.integrate(additions(1, count=4, instance=2))
    state.integrate(additions(2, count=5, instance=1))
    key = additions(0).new.instance_key[:1]
    assert len(state.vehicle_features(key)) == 8


@pytest.mark.parametrize(("removed", "left"), [(10, 10), (14, 6), (15, 0), (19, 0)])
@pytest.mark.parametrize("overtakes", [False, True])
def test_the_rest_of_a_vehicle_that_left_makes_no_group(removed, left, overtakes):
    car, other = additions(0, count=20, instance=1), additions(1, count=4, instance=2)
    keys = np.unique(np.concatenate([car.new.instance_key, other.new.instance_key]))
    gone = removals(9, *car.new.id[:removed])
    state = MapState()
    state.integrate(other)
    first, second = (gone, car) if overtakes else (car, gone)
    state.integrate(first)
    change = state.integrate(second)
    assert change is not None
    assert keys[0] in change.instances
    assert group_by_instance(state, keys).sizes.tolist() == [left, 4]
    assert len(state.features) == 24 - removed
    restored = MapState()
    restored.restore(unpack(pack(state.kept())))
    assert group_by_instance(restored, keys).sizes.tolist() == [left, 4]


@pytest.mark.parametrize("count", [0, 1])
def test_empty_diffs_count_as_versions(count):
    state = MapState()
    for sequence in range(count):
        assert state.integrate(SemanticMapDiff(SESSION, sequence, 0.0, 1.0)) is not None
    assert state.version == count
    assert len(state.features) == 0
