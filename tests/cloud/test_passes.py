"""A car that drives by sees states; only two passes that disagree bracket a change."""

import numpy as np

from autowaze.cloud.broadcast import Update
from autowaze.cloud.passes import Kind, PassJournal
from autowaze.world.feature_map import MapFeatures
from autowaze.world.map_update import MapUpdate
from autowaze.world.parking import Occupancy, SpotState

FREE, TAKEN, UNSURE = Occupancy.VACANT, Occupancy.OCCUPIED, Occupancy.UNKNOWN


def journal_of(*seen):
    """A journal of one spot that was seen (state, at)."""
    journal = PassJournal()
    for version, (occupancy, at) in enumerate(seen, start=1):
        journal.note(update(version, occupancy, at), received_at=at + 2)
    return journal


def update(version, occupancy, at):
    nothing = MapUpdate(version - 1, version, MapFeatures.empty(), np.zeros(0, np.uint64))
    return Update(True, version, (SpotState("S0", occupancy, 0.5, at),), [], nothing)


def told(journal, now=1e6):
    return [(h.kind, h.sighting.observed_at, h.not_before) for h in journal.happenings(now)]


def test_one_pass_is_a_report():
    assert told(journal_of((TAKEN, 100.0))) == [(Kind.REPORT, 100.0, None)]


def test_passes_that_agree_are_reports():
    assert [kind for kind, *_ in told(journal_of((FREE, 100.0), (FREE, 900.0)))] == [Kind.REPORT, Kind.REPORT]


def test_passes_that_disagree_bracket_a_change():
    journal = journal_of((FREE, 100.0), (TAKEN, 900.0), (FREE, 2000.0))
    assert told(journal)[1:] == [(Kind.PARK_START, 900.0, 100.0), (Kind.PARK_END, 2000.0, 900.0)]


def test_a_pass_that_changes_its_mind_counts_by_its_last_word():
    journal = journal_of((TAKEN, 100.0), (FREE, 900.0), (TAKEN, 905.0))
    assert told(journal) == [(Kind.REPORT, 100.0, None), (Kind.REPORT, 905.0, None)]


def test_a_pass_is_not_told_before_it_is_over():
    journal = journal_of((FREE, 100.0))
    assert told(journal, now=130.0) == []
    assert len(told(journal, now=161.0)) == 1


def test_what_comes_late_rewrites_nothing():
    journal = journal_of((FREE, 100.0), (TAKEN, 900.0), (FREE, 500.0))
    assert told(journal) == [(Kind.REPORT, 100.0, None), (Kind.PARK_START, 900.0, 100.0)]


def test_who_is_unsure_says_nothing():
    assert told(journal_of((FREE, 100.0), (UNSURE, 900.0))) == [(Kind.REPORT, 100.0, None)]


def test_a_replay_of_the_log_tells_nothing_twice():
    journal = journal_of((FREE, 100.0), (TAKEN, 900.0))
    journal.note(update(1, FREE, 100.0), 102.0)
    journal.note(update(2, TAKEN, 900.0), 902.0)
    assert len(told(journal)) == 2
