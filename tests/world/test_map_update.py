"""A car's map follows the service's by updates alone."""

from dataclasses import replace

import numpy as np
import pytest
from diffs import random_features

from autowaze.world.errors import AutowazeError, WireError
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.map_update import MapUpdate
from autowaze.world.wire import decode_map_update, encode_map_update

RNG = np.random.default_rng(1)
OLD, NEW = random_features(RNG, 60, 900, 0, 1.7e9), random_features(RNG, 30, 5, 1, 1.7e9 + 60)
UPDATE = MapUpdate(4, 7, NEW, OLD.id[10:20])


def test_an_update_survives_the_wire():
    received = decode_map_update(encode_map_update(UPDATE))
    assert (received.from_version, received.to_version) == (4, 7)
    assert received.added.id.tolist() == NEW.id.tolist()
    assert np.allclose(received.added.position, NEW.position, atol=0.006)
    assert received.removed.tolist() == UPDATE.removed.tolist()


def test_features_of_several_sessions_may_come_in_any_order():
    jumbled = replace(UPDATE, added=MapFeatures.concatenate([OLD[:5], NEW]))
    assert decode_map_update(encode_map_update(jumbled)).added.id.tolist() == sorted(jumbled.added.id.tolist())


def test_an_applied_update_gives_the_newer_map():
    after = UPDATE.applied_to(FeatureMap(OLD, version=4))
    assert after.version == 7
    assert after.features.id.tolist() == sorted({*OLD.id.tolist(), *NEW.id.tolist()} - set(UPDATE.removed.tolist()))


def test_an_update_fits_one_version_only():
    with pytest.raises(AutowazeError, match="from map version 4"):
        UPDATE.applied_to(FeatureMap(OLD, version=3))


def test_mutated_bytes_give_a_typed_error_or_an_update():
    data = encode_map_update(UPDATE)
    for _ in range(300):
        mutated = bytearray(data)
        for place in RNG.integers(0, len(data), 3):
            mutated[place] = RNG.integers(0, 256)
        try:
            decode_map_update(bytes(mutated))
        except WireError:
            continue
