"""One car, honest or not, against what others saw."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from street import Street, features

from autowaze.cloud.belief import DWELL_S, Evidence, believe
from autowaze.cloud.ground_votes import MAX_WINDOWS
from autowaze.cloud.methods import FUSED, THESIS
from autowaze.cloud.service import CloudService
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.identity import instance_keys
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import Occupancy

STREET = Street(count=6)
PARKED = [0, 1, 3, 4]
EMPTY = [2, 5]


def seen(cars, session, start):
    """A pass of a car that reports these spots as taken and all others as free."""
    diffs = STREET.drive(STREET.park(cars), session=session, start=start)
    return diffs if cars else [replace(diff, new=diff.new[:0]) for diff in diffs]


def told(service, diffs, source=None):
    for diff in diffs:
        service.integrate(diff, source=source)
    return service


def taken(service):
    return [i for i, state in enumerate(service.states) if state.occupancy is Occupancy.OCCUPIED]


def free(service):
    return [i for i, state in enumerate(service.states) if state.occupancy is Occupancy.VACANT]


@pytest.fixture
def service():
    """Two cars have seen the street."""
    service = CloudService(STREET.parking_map)
    told(service, seen(PARKED, session=1, start=1000.0))
    told(service, seen(PARKED, session=2, start=1060.0))
    assert (taken(service), free(service)) == (PARKED, EMPTY)
    return service


@pytest.mark.parametrize("later_s", [60.0, 300.0, 1200.0])
@pytest.mark.parametrize("lie", [[], [0, 1, 2, 3, 4, 5]], ids=["all free", "all taken"])
def test_one_car_does_not_overturn_what_two_saw(service, lie, later_s):
    told(service, seen(lie, session=9, start=1060.0 + later_s))
    assert (taken(service), free(service)) == (PARKED, EMPTY)
    contradicted = service.states[PARKED[0] if not lie else EMPTY[0]]
    assert 0.2 < contradicted.probability_vacant < 0.8
    assert "one against 2" in contradicted.evidence


def test_who_repeats_a_lie_a_thousand_times_has_said_it_once(service):
    lies = seen([], session=9, start=1100.0)
    for number in range(1000):
        late = 0.6 * number
        again = [
            replace(diff, session=100 + number, start=diff.start + late, end=diff.end + late, new=diff.new[:0])
            for diff in lies[1:2]
        ]
        told(service, [replace(diff, instances=diff.instances[:0]) for diff in again], source=77)
    assert set(PARKED) <= set(taken(service))
    windows = [service.ground.windows(spot) for spot in PARKED]
    assert all(len(kept) <= MAX_WINDOWS for kept in windows)
    assert all({1, 2} & {window.session for window in kept} for kept in windows)


def test_two_sessions_of_one_token_are_one_witness(service):
    told(service, seen([], session=8, start=1150.0), source=77)
    told(service, seen([], session=9, start=1200.0), source=77)
    assert taken(service) == PARKED
    told(service, seen([], session=10, start=1250.0), source=78)
    assert taken(service) == []
    assert free(service) == [0, 1, 2, 3, 4, 5]


def test_the_next_honest_car_puts_a_lie_right(service):
    told(service, seen([], session=9, start=1100.0))
    told(service, seen(PARKED, session=3, start=1200.0))
    assert (taken(service), free(service)) == (PARKED, EMPTY)
    assert service.states[0].probability_vacant < 0.1


def test_who_only_agreed_before_the_others_looked_is_no_second_witness():
    service = CloudService(STREET.parking_map)
    told(service, seen([], session=1, start=1000.0))  # then cars parked
    told(service, seen(PARKED, session=2, start=1400.0))
    told(service, seen(PARKED, session=3, start=1500.0))
    told(service, seen([], session=9, start=1600.0))
    assert taken(service) == PARKED


def test_one_car_alone_on_a_street_is_believed():
    service = told(CloudService(STREET.parking_map), seen(PARKED, session=1, start=1000.0), source=5)
    assert (taken(service), free(service)) == (PARKED, EMPTY)
    told(service, seen([1, 2], session=2, start=1600.0), source=5)  # it comes back, in another session
    assert {0, 3, 4, 5} <= set(free(service))
    assert 2 in taken(service)


def test_one_car_may_contradict_one_other():
    service = told(CloudService(STREET.parking_map), seen(PARKED, session=1, start=1000.0))
    told(service, seen([0, 1], session=2, start=1600.0))
    assert {3, 4} <= set(free(service))


def test_when_the_others_have_not_looked_for_long_one_car_is_believed(service):
    told(service, seen([], session=9, start=1060.0 + DWELL_S))
    assert free(service) == [0, 1, 2, 3, 4, 5]


def test_the_thesis_method_knows_no_sources():
    services = [CloudService(STREET.parking_map, method=method) for method in (THESIS, replace(THESIS))]
    for service, source in zip(services, (None, 7), strict=True):
        told(service, seen(PARKED, session=1, start=1000.0), source=source)
        told(service, seen(PARKED, session=2, start=1060.0), source=source)
        told(service, seen([], session=9, start=1100.0), source=source)
    assert not THESIS.corroboration
    assert FUSED.corroboration
    assert services[0].states == services[1].states


def landmarks(session, start=1000.0, label=ClassLabel.BACKGROUND):
    """A diff that brings ten features to localise by."""
    places = np.column_stack([np.arange(10.0), np.zeros(10), np.ones(10)])
    new = features(session, 0, places, [np.zeros(10)], start)
    return SemanticMapDiff(session, 0, start, start + 5.0, new=replace(new, label=np.full(10, label, np.uint8)))


def missing(ids, session, start=1100.0, sequence=1):
    return SemanticMapDiff(session, sequence, start, start + 5.0, removed=np.unique(ids))


def test_what_cars_localise_by_goes_when_two_miss_it():
    service, known = CloudService(STREET.parking_map), landmarks(1)
    told(service, [known])
    told(service, [missing(known.new.id, session=2)], source=77)
    told(service, [missing(known.new.id, session=3)], source=77)  # another session of the same token
    assert len(service.map.features) == 10
    told(service, [missing(known.new.id[:4], session=4)], source=78)
    assert service.map.features.id.tolist() == known.new.id[4:].tolist()


@pytest.mark.parametrize("label", [ClassLabel.CAR, ClassLabel.TWO_WHEELER])
def test_a_source_takes_back_what_it_brought_and_one_voice_moves_what_comes_and_goes(label):
    service, known, car = CloudService(STREET.parking_map), landmarks(1), landmarks(2, label=label)
    told(service, [known], source=77)
    told(service, [car, missing(car.new.id, session=5)])
    told(service, [missing(known.new.id, session=6)], source=77)
    assert len(service.map.features) == 0


def test_nobody_can_miss_what_was_not_there_yet():
    service, car = CloudService(STREET.parking_map), landmarks(2, start=1200.0, label=ClassLabel.CAR)
    told(service, [missing(car.new.id, session=5, start=1100.0)])
    told(service, [car])
    assert len(service.map.features) == 10


def test_one_voice_is_enough_against_a_survey_for_vehicles_only():
    known, car = landmarks(1), landmarks(2, label=ClassLabel.CAR)
    both = MapFeatures.concatenate([known.new, replace(car.new, instance_key=instance_keys(2, np.ones(10, np.int64)))])
    service = CloudService(STREET.parking_map, base_map=FeatureMap(both))
    told(service, [missing(both.id, session=5, start=10.0)])
    assert service.map.features.id.tolist() == known.new.id.tolist()
    told(service, [missing(both.id, session=6, start=20.0)])
    assert len(service.map.features) == 0


def test_removals_that_wait_are_bounded_per_source():
    service = CloudService(STREET.parking_map)
    for sequence in range(4):
        ids = np.arange(1 << 16, dtype=np.uint64) + np.uint64((7 << 24) + (sequence << 16))
        told(service, [missing(ids, session=5, sequence=sequence)])
    with pytest.raises(RefusedDiffError, match="too many features removed"):
        told(service, [missing(np.array([1 << 40], np.uint64), session=5, sequence=9)])
    told(service, [missing(np.array([1 << 40], np.uint64), session=6)])


@given(
    votes=st.lists(
        st.tuples(st.integers(2, 4), st.integers(0, 9), st.sampled_from([900.0, 1100.0])), min_size=1, max_size=8
    ),
    data=st.data(),
)
@settings(max_examples=60, deadline=None)
def test_removals_count_in_any_order(votes, data):
    diffs = [landmarks(1)] + [
        missing(landmarks(1).new.id[row:], session=session, start=start, sequence=sequence)
        for sequence, (session, row, start) in enumerate(votes)
    ]
    shuffled = data.draw(st.permutations(diffs))
    maps = []
    for order in (diffs, shuffled):
        service = CloudService(STREET.parking_map)
        for diff in order:
            service.integrate(diff)
        maps.append(service.map.features.id.tolist())
    assert maps[0] == maps[1]


@given(
    items=st.lists(
        st.tuples(st.integers(0, 8), st.sampled_from([-5.0, -1.0, 0.2, 1.0, 5.0]), st.integers(1, 4)), max_size=9
    ),
    randomness=st.randoms(use_true_random=False),
)
@settings(max_examples=200, deadline=None)
def test_a_belief_is_of_the_set_of_evidence(items, randomness):
    evidence = [Evidence(300.0 * time, odds, "seen", source) for time, odds, source in items]
    shuffled = list(evidence)
    randomness.shuffle(shuffled)
    assert believe("A", evidence) == believe("A", shuffled)


@given(lies=st.lists(st.floats(0.0, 900.0), min_size=1, max_size=30), side=st.sampled_from([-1.0, 1.0]))
@settings(max_examples=100, deadline=None)
def test_no_single_source_overturns_two_whatever_it_says_and_when(lies, side):
    honest = [Evidence(0.0, 5.0 * side, "seen", 1), Evidence(100.0, 5.0 * side, "seen", 2)]
    state = believe("A", honest + [Evidence(time, -5.0 * side, "lie", 3) for time in lies])
    occupied = 1.0 - state.probability_vacant
    assert (occupied if side > 0 else 1.0 - occupied) >= 0.6


def test_one_source_is_believed_as_without_sources():
    rng = np.random.default_rng(0)
    evidence = [
        Evidence(float(t), float(odds), "seen", 7)
        for t, odds in zip(range(0, 900, 100), rng.normal(0, 3, 9), strict=True)
    ]
    assert believe("A", evidence) == believe("A", evidence, corroboration=False)
