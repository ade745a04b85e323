"""A service that was read from a snapshot is the one that was kept, in everything that it says from then on."""

import threading
from dataclasses import replace

import numpy as np
import pytest
import zstandard
from street import Street

from autowaze.cloud.passes import PassJournal
from autowaze.cloud.service import CloudService
from autowaze.cloud.snapshot import GivenUpError, SnapshotError, pack, packed_parts, unpack

STREET = Street(count=10)


def drives(passes=6):
    """Cars pass; each finds other cars parked and misses what the one before it reported."""
    found, before = [], []
    for number in range(passes):
        parked = np.random.default_rng(number).choice(STREET.count, 6, replace=False).tolist()
        diffs = STREET.drive(STREET.park(parked, number), number + 1, 1000.0 + 400.0 * number)
        gone = [diff.new.id for diff in before] + [np.zeros(0, np.uint64)] * len(diffs)
        before = diffs
        found += [replace(diff, removed=ids) for diff, ids in zip(diffs, gone, strict=False)]
    return found


def followed(service, journal, diffs):
    for diff in diffs:
        journal.note(service.integrate(diff), diff.end)


def opened(method="fused", street=STREET):
    return CloudService(street.parking_map, method), PassJournal()


@pytest.mark.parametrize("method", ["fused", "thesis"])
@pytest.mark.parametrize("cut", [1, 7, 12])
def test_snapshot_and_the_rest_of_the_log_equal_the_whole_log(method, cut):
    diffs = drives()
    whole, journal = opened(method)
    followed(whole, journal, diffs[:cut])
    data = pack({"service": whole.kept(), "journal": journal.kept()})
    followed(whole, journal, diffs[cut:])

    restored, restored_journal = opened(method)
    kept = unpack(data)
    assert restored.restore(kept["service"])
    restored_journal.restore(kept["journal"])
    followed(restored, restored_journal, diffs[cut:])

    assert restored.states == whole.states
    assert pack(restored.kept()) == pack(whole.kept())
    assert restored_journal.happenings(1e9) == journal.happenings(1e9)
    assert len(restored.map_update_since(cut - 1).added) == len(whole.map_update_since(cut - 1).added)
    assert not restored.integrate(diffs[0]).accepted


def test_a_snapshot_of_another_method_is_refused():
    service, _ = opened()
    kept = unpack(pack(service.kept()))
    other, _ = opened("thesis")
    with pytest.raises(SnapshotError, match="method"):
        other.restore(kept)


def test_spots_that_lie_where_they_lay_keep_their_state():
    service, journal = opened()
    followed(service, journal, drives())
    kept = unpack(pack(service.kept()))
    longer = Street(count=12)
    other, _ = opened(street=longer)
    assert not other.restore(kept)
    assert other.states[: STREET.count] == service.states
    assert all(state.observed_at is None for state in other.states[STREET.count :])


def test_whatever_bytes_are_no_snapshot():
    service, _ = opened()
    data = pack(service.kept())
    unknown = zstandard.ZstdCompressor().compress(b"\x82\xa6format\x01\xa1a\xc7\x02\x01\x00\x00")
    strange = zstandard.ZstdCompressor().compress(b"\x81\xa6format\x07")
    for bad in (b"", b"nonsense", data[:-20], unknown, strange):
        with pytest.raises(SnapshotError):
            unpack(bad)


def test_a_snapshot_is_of_the_time_it_was_asked_for():
    diffs = drives()
    service, journal = opened()
    followed(service, journal, diffs[:7])
    kept = {"service": service.kept(), "journal": journal.kept()}
    expected = pack(kept)
    parts = packed_parts(kept)
    followed(service, journal, diffs[7:])
    assert b"".join(parts) == expected


def test_packing_takes_its_time_until_it_is_given_up():
    until = threading.Event()
    parts = packed_parts({"rows": [np.random.default_rng(row).bytes(1000) for row in range(10_000)]}, until)
    next(parts)
    until.set()
    with pytest.raises(GivenUpError):
        list(parts)


def test_what_cannot_be_kept_is_no_snapshot():
    with pytest.raises(SnapshotError, match="object cannot be kept in a snapshot"):
        pack({"unknown": object()})
