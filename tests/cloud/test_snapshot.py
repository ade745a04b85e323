"""A service that was read from a snapshot is the one that was kept, in everything that it says from then on."""

import fcntl
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
import zstandard
from street import Street

from autowaze.cloud.packing import GivenUpError, Packing
from autowaze.cloud.passes import PassJournal
from autowaze.cloud.service import CloudService
from autowaze.cloud.snapshot import SnapshotError, pack, unpack

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


def test_a_copy_of_the_process_packs_what_was_there():
    kept = {"rows": [[np.arange(4)] for _ in range(50_000)], "text": "as it was"}
    expected = pack(kept)
    packing = Packing(lambda: kept)
    kept["text"] = "another"
    with packing as parts:
        assert b"".join(parts) == expected
    with Packing(lambda: kept) as parts:  # of no use any more
        next(parts)


def test_a_copy_that_fails_keeps_no_snapshot(capfd):
    with Packing(lambda: {"unknown": object()}) as parts, pytest.raises(SnapshotError, match="ended with status 1"):
        list(parts)
    assert "object cannot be kept in a snapshot" in capfd.readouterr().err


def test_a_copy_takes_its_time_until_it_is_given_up():
    until = threading.Event()
    kept = {"rows": [[np.random.default_rng(row).bytes(1000)] for row in range(4000)]}
    with Packing(lambda: kept, until) as parts, pytest.raises(GivenUpError):
        next(parts)
        until.set()
        list(parts)


def test_without_copies_the_process_packs_itself(monkeypatch):
    def fork():
        raise OSError("too little memory")

    monkeypatch.setattr("os.fork", fork)
    with Packing(lambda: {"one": 1}) as parts:
        assert unpack(b"".join(parts))["one"] == 1


def test_a_copy_lets_go_of_what_is_the_process_s(tmp_path):
    lock = (tmp_path / "lock").open("w")
    fcntl.flock(lock, fcntl.LOCK_EX)
    with Packing(lambda: time.sleep(30)):
        deadline = time.monotonic() + 10
        lock.close()  # the lock is free once nobody has it open
        with (tmp_path / "lock").open("w") as other:
            while True:
                try:
                    fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except OSError:
                    assert time.monotonic() < deadline
                    time.sleep(0.01)
