"""The outbox keeps order and bytes over restarts, within its bounds."""

import pytest

from autowaze.vehicle.outbox import KEPT_REFUSED, Outbox, OutboxError


def emptied(outbox):
    messages = []
    while item := outbox.first():
        messages.append(item[1])
        outbox.remove(item[0])
    return messages


def test_diffs_come_out_in_the_order_in_which_they_went_in(tmp_path):
    outbox = Outbox(tmp_path)
    for number in range(12):
        outbox.put(b"%d" % number)
    assert emptied(outbox) == [b"%d" % number for number in range(12)]


def test_a_restart_goes_on_where_the_last_drive_stopped(tmp_path):
    before = Outbox(tmp_path)
    before.put(b"first")
    before.put(b"second")
    before.close()
    (tmp_path / "000000000009.partial").write_bytes(b"torn by a power cut")
    after = Outbox(tmp_path)
    after.put(b"third")
    assert emptied(after) == [b"first", b"second", b"third"]
    assert not list(tmp_path.glob("*.partial"))


def test_a_full_outbox_lets_the_oldest_go(tmp_path):
    outbox = Outbox(tmp_path, most_bytes=1000)
    for number in range(20):
        outbox.put(bytes([number]) * 100)
    assert outbox.dropped == 10
    assert sum(path.stat().st_size for path in tmp_path.glob("*.diff")) <= 1000
    assert [message[0] for message in emptied(outbox)] == list(range(10, 20))


def test_refused_diffs_are_kept_aside_for_a_person_but_not_for_ever(tmp_path):
    outbox = Outbox(tmp_path)
    for number in range(KEPT_REFUSED + 5):
        outbox.put(b"%d" % number)
        outbox.set_aside(outbox.first()[0])
    assert outbox.first() is None
    assert len(list((tmp_path / "refused").glob("*.diff"))) == KEPT_REFUSED


def test_two_cars_cannot_share_an_outbox(tmp_path):
    first = Outbox(tmp_path)
    with pytest.raises(OutboxError, match="another car"):
        Outbox(tmp_path)
    first.close()
    Outbox(tmp_path).close()


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutboxError, match="file/outbox"):
        Outbox(tmp_path / "file" / "outbox")


def test_a_diff_that_vanished_does_not_hold_up_the_others(tmp_path):
    outbox = Outbox(tmp_path)
    outbox.put(b"gone")
    outbox.put(b"here")
    (tmp_path / "000000000001.diff").unlink()
    assert outbox.first()[1] == b"here"
    assert outbox.dropped == 1
