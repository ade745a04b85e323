"""What the service promises to those who feed it and to those who listen."""

from dataclasses import replace

import numpy as np
import pytest
from street import Street

from autowaze.cloud.broadcast import OutdatedMapError
from autowaze.cloud.service import CloudService
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.errors import WireError
from autowaze.world.georeference import Georeference
from autowaze.world.identity import feature_ids
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.wire import encode_diff

STREET = Street(count=6)
DIFFS = STREET.drive(STREET.park([0, 2, 3]))


def test_receiving_twice_changes_nothing():
    service = CloudService(STREET.parking_map)
    payload = encode_diff(DIFFS[0])
    first, second = service.receive(payload), service.receive(payload)
    assert first.accepted
    assert first.spots
    assert not second.accepted
    assert second.spots == ()
    assert second.version == first.version == 1


def test_updates_bring_a_car_to_the_services_map():
    service = CloudService(STREET.parking_map)
    for diff in DIFFS:
        service.integrate(diff)
    gone = service.feature_map.features.id[:3]
    service.integrate(SemanticMapDiff(5, 0, 2000.0, 2001.0, removed=gone))
    update = service.map_update_since(0)
    assert sorted(update.added.id.tolist()) == service.feature_map.features.id.tolist()
    assert len(update.removed) == 0
    late = service.map_update_since(len(DIFFS))
    assert late.removed.tolist() == gone.tolist()
    assert len(service.map_update_since(service.map.version).added) == 0
    with pytest.raises(OutdatedMapError, match="fetch the whole map"):
        service.map_update_since(99)


def test_removed_features_make_the_spot_vacant_again():
    service = CloudService(STREET.parking_map, method="thesis")
    for diff in DIFFS:
        service.integrate(diff)
    features = service.feature_map.features
    car = features.id[features.instance_key == features.instance_key[0]]
    update = service.integrate(SemanticMapDiff(5, 0, 2000.0, 2001.0, removed=car))
    assert [state.spot_id for state in update.spots] == ["S0"]
    assert service.states[0].occupancy == "vacant"


def impossible(diff):
    far = diff.new.position + np.array([3e5, 0.0, 0.0])
    nan = np.where(np.arange(len(far))[:, None] == 1, np.nan, diff.new.position)
    doubled = diff.ground[np.append(np.arange(len(diff.ground)), 0)]
    return {
        "another map": replace(diff, georeference=Georeference(10.0, 10.0)),
        "ids of another": replace(diff, new=replace(diff.new, id=feature_ids(99, 0, len(far)))),
        "instances of another": replace(
            diff, new=replace(diff.new, instance_key=diff.new.instance_key + (np.uint64(1) << np.uint64(24)))
        ),
        "far away": replace(diff, new=replace(diff.new, position=far)),
        "not a number": replace(diff, new=replace(diff.new, position=nan)),
        "two votes": replace(diff, ground=doubled),
        "huge ground": replace(diff, ground=replace(diff.ground, ix=diff.ground.ix * 1000)),
        "backwards": replace(diff, start=10.0, end=5.0),
        "two rows": replace(diff, instances=diff.instances[np.array([0, 0])]),
        "unsorted": replace(diff, removed=np.array([5, 3], dtype=np.uint64)),
    }


@pytest.mark.parametrize("kind", sorted(impossible(DIFFS[0])))
def test_an_impossible_diff_is_refused_and_leaves_no_trace(kind):
    service = CloudService(STREET.parking_map)
    service.integrate(DIFFS[1])
    before = service.states, service.feature_map.features.id.tobytes(), service.map.version
    with pytest.raises(RefusedDiffError, match="refused"):
        service.integrate(impossible(DIFFS[0])[kind])
    assert (service.states, service.feature_map.features.id.tobytes(), service.map.version) == before
    assert service.integrate(DIFFS[0]).accepted


def test_bytes_that_are_no_diff_are_refused():
    service = CloudService(STREET.parking_map)
    with pytest.raises(WireError):
        service.receive(b"not a diff")
    assert service.map.version == 0


def test_every_stage_is_timed():
    service = CloudService(STREET.parking_map)
    service.receive(encode_diff(DIFFS[0]))
    assert set(service.times.milliseconds) >= {"decode", "integration", "grouping", "boxes", "occupancy", "broadcast"}
