"""A new process goes on from a snapshot; a service outlasts its database."""

import time
from dataclasses import replace

import numpy as np
import pytest
from serving import assert_problem, running
from street import Street

from autowaze.cloud.durable import DurableService
from autowaze.cloud.passes import PassJournal
from autowaze.cloud.service import CloudService
from autowaze.cloud.spot_edits import SpotEdit
from autowaze.cloud.store import StoreError, open_store
from autowaze.cloud.upkeep import Retention, Upkeep
from autowaze.world.wire import encode_diff

STREET = Street(count=6)


def messages(passes):
    found = []
    for number in range(passes):
        parked = np.random.default_rng(number).choice(STREET.count, 3, replace=False).tolist()
        found += STREET.drive(STREET.park(parked, number), number + 1, 1000.0 + 400.0 * number)
    return [encode_diff(diff) for diff in found]


PAYLOADS = messages(6)


def opened(address, method="fused", street=STREET, clock=lambda: 5.0):
    journal = PassJournal()
    durable = DurableService(
        lambda: CloudService(street.parking_map, method),
        open_store(address),
        clock,
        observe=journal.note,
        followers={"passes": journal},
    )
    return durable, journal


def drawn(ring_of, spot_id="S2", shift=0.3):
    """The spot redrawn a little aside."""
    ring = STREET.parking_map.georeference.to_lon_lat(
        np.array(ring_of.polygon.exterior.coords) + np.array([shift, 0.0])
    )
    return SpotEdit(spot_id, tuple((float(lon), float(lat)) for lon, lat in ring), "parallel")


def test_a_pruned_log_and_its_snapshots_tell_what_the_whole_log_tells(address, tmp_path):
    whole, journal = opened(tmp_path / "undisturbed.db")
    edit = drawn(STREET.parking_map.spots[2])
    durable, _ = opened(address)
    for number, payload in enumerate(PAYLOADS):
        whole.receive(payload)
        durable.receive(payload)
        if number == 4:
            whole.edit(edit, "operator")
            durable.edit(edit, "operator")
        if number in (3, 6):
            durable.snapshot()
    assert durable.store.prune(1e9, 0.0) == 4
    durable.store.close()

    again, restored_journal = opened(address)
    assert again.store.position == len(PAYLOADS)
    assert again.service.states == whole.service.states
    assert again.service.map.version == whole.service.map.version
    assert np.array_equal(again.service.feature_map.features.id, whole.service.feature_map.features.id)
    assert restored_journal.happenings(1e9) == journal.happenings(1e9)
    assert not again.receive(PAYLOADS[0]).accepted
    again.store.close()
    whole.store.close()


def test_a_snapshot_spares_the_replay(tmp_path, monkeypatch):
    durable, _ = opened(tmp_path / "cloud.db")
    with Upkeep(durable):
        for payload in PAYLOADS:
            durable.receive(payload)
    durable.store.close()
    integrated = []
    monkeypatch.setattr(CloudService, "integrate", lambda *given: integrated.append(given))
    again, _ = opened(tmp_path / "cloud.db")
    assert not integrated
    assert again.service.states == durable.service.states
    again.store.close()


def test_with_the_log_pruned_another_method_cannot_start(tmp_path):
    durable, _ = opened(tmp_path / "cloud.db")
    for payload in PAYLOADS:
        durable.receive(payload)
        durable.snapshot()
    upkeep = Upkeep(durable, Retention(diffs_days=1.0), clock=lambda: 1e9)
    upkeep.tidy()
    assert durable.store.oldest > 1
    durable.store.close()
    with pytest.raises(StoreError, match="pruned"):
        opened(tmp_path / "cloud.db", "thesis")


def test_spots_drawn_in_the_file_begin_anew_where_the_log_is_pruned(tmp_path):
    durable, _ = opened(tmp_path / "cloud.db")
    for payload in PAYLOADS:
        durable.receive(payload)
        durable.snapshot()
    durable.store.prune(1e9, 0.0)
    durable.store.close()
    longer = replace(STREET, count=STREET.count + 2)
    again, _ = opened(tmp_path / "cloud.db", street=longer)
    assert again.service.states[: STREET.count] == durable.service.states
    assert len(again.service.states) == STREET.count + 2
    again.store.close()


def test_a_service_answers_503_while_its_database_is_away_and_goes_on_when_it_is_back(server, payloads):
    with running(server.make("away")) as site:
        assert site.hand_in(payloads[0]).status_code == 202
        server.stop()
        try:
            assert_problem(site.hand_in(payloads[1]), 503, "not_kept")
            assert_problem(site.client.get("/ready"), 503, "not_ready")
            assert site.client.get("/spots.geojson").status_code == 200
        finally:
            server.start()
        for _ in range(100):
            if site.client.get("/ready").status_code == 200:
                break
            time.sleep(0.1)
        assert site.hand_in(payloads[0]).status_code == 200
        assert site.hand_in(payloads[1]).status_code == 202
        assert site.durable.store.position == 2
