"""Diffs of different places are settled together, those of one place one after the other."""

from dataclasses import replace

import numpy as np
import pytest
from street import GEOREFERENCE, Street

from autowaze.cloud.durable import DurableService
from autowaze.cloud.service import CloudService
from autowaze.cloud.settlement import Settlement
from autowaze.cloud.store import open_store
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.errors import WireError
from autowaze.world.georeference import Georeference
from autowaze.world.map_diff import SemanticMapDiff, Trajectory
from autowaze.world.wire import encode_diff

STREET = Street(count=6)


def _passes():
    first = STREET.drive(STREET.park([0, 1, 3]), session=1)
    return first + STREET.drive(STREET.park([1, 2]), session=2, start=5000.0)


def _far_away(session):
    """A window half a kilometre from the street, of which there is nothing to tell."""
    path = Trajectory(np.array([1000.0]), np.array([[500.0, 0.0, 0.0]]), np.zeros(1, np.float32))
    return SemanticMapDiff(session, 0, 1000.0, 1001.0, georeference=GEOREFERENCE, trajectory=path)


def test_updates_are_those_of_one_after_the_other():
    one_by_one, together = (CloudService(STREET.parking_map) for _ in range(2))
    expected = [one_by_one.integrate(diff) for diff in _passes()]
    settlement = Settlement(together)
    for diff in _passes():
        settlement.take(diff)
    updates = settlement.settle()
    assert [update.spots for update in updates] == [update.spots for update in expected]
    assert [update.version for update in updates] == [update.version for update in expected]
    assert [update.vacant for update in updates] == [update.vacant for update in expected]


def settled_together(method, diffs):
    """How many diffs were settled at once, time after time."""
    service, counts = CloudService(STREET.parking_map, method), []
    settle = service.settle
    service.settle = lambda taken: counts.append(len(taken)) or settle(taken)
    settlement = Settlement(service)
    for diff in diffs:
        settlement.take(diff)
    assert [update.accepted for update in settlement.settle()] == [True] * len(diffs)
    assert settlement.settle() == []
    return counts


def test_only_diffs_of_one_place_wait_for_each_other():
    here, there = _passes()[:2], [_far_away(session) for session in (7, 8)]
    assert settled_together("fused", (here[0], there[0], here[1], there[1])) == [2, 2]


def test_a_method_without_instances_settles_each_diff_alone():
    assert settled_together("carmap", (_passes()[0], _far_away(7))) == [1, 1]


def test_a_refused_diff_keeps_no_update_of_those_before_it_back():
    first, second = _passes()[:2]
    settlement = Settlement(CloudService(STREET.parking_map))
    settlement.take(first)
    with pytest.raises(RefusedDiffError):
        settlement.take(replace(second, end=second.start - 1.0))
    settlement.take(second)
    assert [update.version for update in settlement.settle()] == [1, 2]


def test_a_batch_with_a_bad_diff_between_good_ones_of_its_place_answers_each(tmp_path):
    first, second = _passes()[:2]
    wrong = encode_diff(replace(second, georeference=Georeference(50.0, 8.0)))
    durable = DurableService(lambda: CloudService(STREET.parking_map), open_store(tmp_path / "cloud.db"), lambda: 5.0)
    answers = durable.receive_many([encode_diff(first), wrong, encode_diff(second), encode_diff(first)])
    assert isinstance(answers[1], WireError)
    assert [(answers[row].version, answers[row].accepted) for row in (0, 2, 3)] == [(1, True), (2, True), (2, False)]
    assert durable.store.position == 2
