"""What was acknowledged is never lost and never counts twice."""

import os
import pickle
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from street import Street

from autowaze.cloud.durable import DurableService
from autowaze.cloud.service import CloudService
from autowaze.cloud.store import SqliteStore, StoreError, open_store
from autowaze.world.errors import WireError
from autowaze.world.wire import encode_diff

STREET = Street(count=4)
KILLS_AFTER = (1, 9, 40)


def messages(passes):
    """Diffs of cars that pass one after the other; ground and features thinned, the store does not mind."""
    diffs = STREET.drive(STREET.park([0, 2]))
    return [encode_diff(renamed(diff, session, 600.0 * session)) for session in range(1, passes + 1) for diff in diffs]


def renamed(diff, session, later):
    new = diff.new[:0]
    return replace(
        diff, session=session, start=diff.start + later, end=diff.end + later, new=new, trajectory=diff.trajectory[:0]
    )


def opened(path, method="fused"):
    return DurableService(lambda: CloudService(STREET.parking_map, method), open_store(path), clock=lambda: 1.0)


def undisturbed(payloads):
    service = CloudService(STREET.parking_map)
    for payload in payloads:
        service.receive(payload)
    return service


def kept(path):
    return {state.spot_id: state for state in SqliteStore(path).spots()}


def test_a_new_process_goes_on_where_the_last_one_stopped(tmp_path):
    payloads = messages(2)
    first = opened(tmp_path / "cloud.db")
    for payload in payloads[:2]:
        first.receive(payload)
    first.store.close()
    second = opened(tmp_path / "cloud.db")
    assert second.service.map.version == second.store.position == 2
    assert not second.receive(payloads[0]).accepted
    for payload in payloads[2:]:
        second.receive(payload)
    assert second.service.states == undisturbed(payloads).states
    assert kept(tmp_path / "cloud.db") == {state.spot_id: state for state in second.service.states}


def test_kill_9_loses_nothing_acknowledged_and_counts_nothing_twice(address, tmp_path):
    payloads = messages(60)
    (tmp_path / "messages").write_bytes(pickle.dumps(payloads))
    acknowledged = 0
    for kill_after in KILLS_AFTER:
        process = subprocess.Popen(
            [sys.executable, "ingest.py", str(address), tmp_path / "messages", str(STREET.count)],
            cwd=Path(__file__).parent,
            stdout=subprocess.PIPE,
            text=True,
        )
        with process:
            for line in process.stdout:
                acknowledged = max(acknowledged, int(line) + 1)
                if int(line) >= kill_after:
                    os.kill(process.pid, signal.SIGKILL)
                    break
        store = open_store(address)
        assert store.position >= acknowledged > kill_after
        log = [accepted.payload for accepted in store.log()]
        assert log == payloads[: store.position]
        store.close()
    recovered = opened(address)
    assert recovered.service.states == undisturbed(log).states
    stored = {state.spot_id: state for state in recovered.store.spots()}
    assert stored.items() <= {state.spot_id: state for state in recovered.service.states}.items()
    recovered.store.close()


def test_a_bad_message_does_not_touch_the_others(tmp_path):
    payloads = messages(3)
    durable = opened(tmp_path / "cloud.db")
    results = durable.receive_many([payloads[0], b"nonsense", payloads[1]])
    assert [type(result).__name__ for result in results] == ["Update", "WireError", "Update"]
    assert durable.store.position == 2
    with pytest.raises(WireError):
        durable.receive(b"nonsense")


def test_what_could_not_be_kept_is_not_believed(tmp_path):
    payloads = messages(3)
    durable = opened(tmp_path / "cloud.db")
    durable.receive(payloads[0])
    before = durable.service.states
    keep = durable.store.commit
    durable.store.commit = full_disk
    with pytest.raises(StoreError, match="full"):
        durable.receive(payloads[1])
    assert durable.service.states == before
    durable.store.commit = keep
    assert durable.receive(payloads[1]).accepted


def full_disk(accepted, changed):
    raise StoreError("the disk is full")


def test_two_services_cannot_write_one_store(tmp_path):
    payloads = messages(3)
    one, other = opened(tmp_path / "cloud.db"), opened(tmp_path / "cloud.db")
    one.receive(payloads[0])
    with pytest.raises(StoreError, match="another process"):
        other.receive(payloads[1])
    assert one.receive(payloads[1]).accepted


def test_another_method_starts_from_the_same_log(tmp_path):
    payloads = messages(3)
    durable = opened(tmp_path / "cloud.db")
    durable.receive_many(payloads)
    durable.store.close()
    other = opened(tmp_path / "cloud.db", "thesis")
    assert kept(tmp_path / "cloud.db") == {s.spot_id: s for s in other.service.states if s.observed_at is not None}


def test_a_file_that_is_no_store_is_named(tmp_path):
    path = tmp_path / "holiday.jpg"
    path.write_bytes(b"not a database" * 100)
    with pytest.raises(StoreError, match=r"holiday\.jpg"):
        SqliteStore(path)
