"""A set of diffs leads to one state, whatever their order."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from street import Street

from autowaze.cloud.methods import METHODS
from autowaze.cloud.service import CloudService

STREET = Street(count=8)


def two_passes():
    """Diffs of two cars, some told again; other spots are taken when the second one passes."""
    diffs = STREET.drive(STREET.park([0, 1, 3, 6]), session=1) + STREET.drive(
        STREET.park([1, 2, 3]), session=2, start=5000.0, drift=(0.2, -0.1)
    )
    return [diffs[i % len(diffs)] for i in range(6)]


@pytest.mark.parametrize("method", METHODS)
@given(order=st.permutations(range(6)), repeated=st.integers(0, 5))
@settings(max_examples=8, deadline=None)
def test_the_order_of_arrival_does_not_matter(method, order, repeated):
    diffs = two_passes()
    straight, shuffled = (CloudService(STREET.parking_map, method=method) for _ in range(2))
    for diff in diffs:
        straight.integrate(diff)
    for i in [*order, repeated]:
        shuffled.integrate(diffs[i])
    assert straight.states == shuffled.states
    assert straight.vacant() == shuffled.vacant()
    assert list(straight.vehicle_boxes) == list(shuffled.vehicle_boxes)


@pytest.mark.parametrize("method", METHODS)
@given(cuts=st.sets(st.integers(1, 5)))
@settings(max_examples=6, deadline=None)
def test_diffs_taken_together_lead_to_the_state_of_one_after_the_other(method, cuts):
    diffs = two_passes()
    straight, together = (CloudService(STREET.parking_map, method=method) for _ in range(2))
    for diff in diffs:
        straight.integrate(diff)
    told = {}
    for first, end in pairwise([0, *sorted(cuts), len(diffs)]):
        updates = together.settle([together.take(diff) for diff in diffs[first:end]])
        assert [update.version for update in updates if update.accepted] == sorted(
            {update.version for update in updates if update.accepted}
        )
        for update in updates:
            told.update({state.spot_id: state for state in update.spots})
    assert straight.states == together.states
    assert straight.vacant() == together.vacant()
    assert list(straight.vehicle_boxes) == list(together.vehicle_boxes)
    assert all(state == told[state.spot_id] for state in together.states if state.spot_id in told)
    assert {state.spot_id for state in together.states if state.observed_at is not None} == set(told)
