"""Handing in diffs: durable before it is acknowledged, repeatable, and proof against whatever else arrives."""

import hashlib
import socket
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import httpx
import numpy as np
import pytest
from serving import NOW, assert_problem, running

from autowaze.cloud.admission import CarefulAdmission, TimelyAdmission
from autowaze.cloud.api.guard import RateLimit
from autowaze.cloud.store import SqliteStore, StoreError
from autowaze.cloud.store.tokens import Scope, TokenRegister
from autowaze.world.georeference import Georeference
from autowaze.world.wire import MAX_MESSAGE_BYTES, encode_diff


def test_an_acknowledged_diff_is_in_the_store(site, payloads):
    response = site.hand_in(payloads[0])
    assert response.status_code == 202
    assert response.json() == {
        "accepted": True,
        "map_version": 1,
        "sha256": hashlib.sha256(payloads[0]).hexdigest(),
    }
    assert [kept.payload for kept in SqliteStore(site.durable.store.path).log()] == [payloads[0]]


def test_handing_in_twice_is_harmless(site, payloads):
    site.hand_in(payloads[0])
    again = site.hand_in(payloads[0])
    assert again.status_code == 200
    assert not again.json()["accepted"]
    assert site.durable.store.position == 1


def test_many_cars_at_once_are_each_taken_in_once(site, passes):
    with ThreadPoolExecutor(16) as cars:
        statuses = list(cars.map(lambda payload: site.hand_in(payload).status_code, [*passes, *passes]))
    assert sorted(set(statuses)) == [200, 202]
    assert statuses.count(202) == site.durable.store.position == len(passes)
    assert sorted(kept.payload for kept in site.durable.store.log()) == sorted(passes)


def test_what_is_no_diff_is_refused(site, diffs, payloads):
    assert_problem(site.hand_in(b""), 400, "not_a_diff")
    assert_problem(site.hand_in(b"nonsense"), 400, "not_a_diff")
    assert_problem(site.hand_in(bytes(MAX_MESSAGE_BYTES + 1)), 413, "too_large")
    elsewhere = encode_diff(replace(diffs[0], georeference=Georeference(10.0, 10.0)))
    assert_problem(site.hand_in(elsewhere), 422, "diff_refused")
    assert_problem(site.client.post("/v1/diffs", content=payloads[0]), 415, "unsupported_media_type")
    assert_problem(site.hand_in(payloads[0], **{"Content-Encoding": "gzip"}), 415, "unsupported_media_type")
    assert_problem(site.client.get("/v1/diffs"), 405, "method_not_allowed")
    assert_problem(site.client.get("/nowhere"), 404, "not_found")
    assert site.durable.store.position == 0


def test_a_body_of_unknown_length_is_cut_off(site):
    endless = (bytes(1 << 16) for _ in range(MAX_MESSAGE_BYTES // (1 << 16) + 2))
    assert_problem(site.hand_in(endless), 413, "too_large")


def test_mutated_diffs_never_bring_the_service_down(site, payloads):
    rng = np.random.default_rng(3)
    for _ in range(300):
        mutated = bytearray(payloads[0][:2000])
        for place in rng.integers(0, len(mutated), 4):
            mutated[place] = rng.integers(0, 256)
        assert site.hand_in(bytes(mutated)).status_code in (200, 202, 400, 422)
    assert site.hand_in(payloads[1]).status_code == 202


def test_broken_http_does_not_disturb_others(site, payloads):
    host, port = site.url.removeprefix("http://").split(":")
    for garbage in (
        b"\x16\x03\x01\x00",
        b"POST /v1/diffs HTTP/1.1\r\nContent-Length: -5\r\n\r\n",
        b"GET " + b"a" * 99_999,
    ):
        with socket.create_connection((host, int(port)), timeout=5) as connection:
            connection.sendall(garbage)
    assert site.hand_in(payloads[0]).status_code == 202


def test_a_diff_that_could_not_be_kept_is_not_acknowledged(site, payloads):
    keep = site.durable.store.commit

    def full_disk(accepted, changed):
        raise StoreError("/secret/path: the disk is full")

    site.durable.store.commit = full_disk
    response = site.hand_in(payloads[0])
    assert_problem(response, 503, "not_kept")
    assert "secret" not in response.text
    assert int(response.headers["Retry-After"]) > 0
    assert_problem(site.client.get("/ready"), 503, "not_ready")
    site.durable.store.commit = keep
    assert site.hand_in(payloads[0]).status_code == 202
    assert site.client.get("/ready").status_code == 200


def _poisons(asked, *rest):
    taken = asked if isinstance(asked, list) else [SimpleNamespace(diff=asked)]
    return any(one.diff.sequence == 1 for one in taken)


@pytest.mark.parametrize("step", ["take", "settle"])
def test_one_poisonous_diff_does_not_take_others_with_it(site, payloads, step):
    healthy = getattr(type(site.durable.service), step)

    def poisoned(service, *asked):
        if _poisons(*asked):
            raise RuntimeError("a defect")
        return healthy(service, *asked)

    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(8) as cars:
        patch.setattr(f"autowaze.cloud.service.CloudService.{step}", poisoned)
        responses = list(cars.map(site.hand_in, payloads))
    assert [response.status_code == 202 for response in responses] == [n != 1 for n in range(len(payloads))]
    assert_problem(responses[1], 500, "internal")
    assert "defect" not in responses[1].text


def test_only_good_tokens_of_the_right_scope_are_let_in(tmp_path, payloads):
    tokens = TokenRegister(tmp_path / "cloud.db")
    car, reader = tokens.add("car", frozenset(Scope)), tokens.add("reader", frozenset({Scope.MAP}))
    with running(tmp_path / "cloud.db", tokens) as site:
        unknown = site.hand_in(payloads[0], Authorization="Bearer awz_guess")
        assert_problem(unknown, 401, "unauthorized")
        assert unknown.headers["WWW-Authenticate"].startswith("Bearer")
        assert_problem(site.hand_in(payloads[0]), 401, "unauthorized")
        assert_problem(site.hand_in(payloads[0], Authorization=f"Bearer {reader}"), 403, "forbidden")
        assert_problem(site.client.get("/map"), 401, "unauthorized")
        assert site.client.get("/map", headers={"Authorization": f"Bearer {reader}"}).status_code == 200
        assert site.hand_in(payloads[0], Authorization=f"Bearer {car}").status_code == 202
        tokens.revoke("car")
        assert_problem(site.hand_in(payloads[1], Authorization=f"Bearer {car}"), 401, "unauthorized")
        assert site.client.get("/spots.geojson").status_code == 200
    assert car.encode() not in (tmp_path / "cloud.db").read_bytes()
    with pytest.raises(StoreError, match="another name"):
        tokens.add("car", frozenset(Scope))
    tokens.close()


def test_a_car_that_sends_too_much_is_told_when_to_come_back(tmp_path, payloads):
    tokens = TokenRegister(tmp_path / "cloud.db")
    secret, other = tokens.add("car", frozenset(Scope)), tokens.add("other", frozenset(Scope))
    with running(tmp_path / "cloud.db", tokens, RateLimit(per_second=0.01, burst=2)) as site:
        sent = [site.hand_in(payloads[0], Authorization=f"Bearer {secret}") for _ in range(3)]
        assert [response.status_code for response in sent] == [202, 200, 429]
        assert_problem(sent[2], 429, "too_many_requests")
        assert int(sent[2].headers["Retry-After"]) >= 1
        assert site.hand_in(payloads[0], Authorization=f"Bearer {other}").status_code == 200
    tokens.close()


def test_what_was_seen_in_the_future_or_last_month_is_refused(tmp_path, diffs):
    with running(tmp_path / "cloud.db", admit=CarefulAdmission(timely=TimelyAdmission(lambda: NOW))) as site:
        ahead = replace(diffs[0], end=NOW + 1500)
        assert_problem(site.hand_in(encode_diff(ahead)), 422, "diff_refused")
        assert site.hand_in(encode_diff(diffs[0])).status_code == 202
    later = NOW + 30 * 86_400
    with running(tmp_path / "cloud.db", admit=CarefulAdmission(timely=TimelyAdmission(lambda: later))) as site:
        assert_problem(site.hand_in(encode_diff(diffs[1])), 422, "diff_refused")
        assert site.hand_in(encode_diff(diffs[0])).status_code == 200


def test_a_stopped_service_answers_nobody_but_keeps_everything(tmp_path, payloads):
    with running(tmp_path / "cloud.db") as site:
        site.hand_in(payloads[0])
    with pytest.raises(httpx.ConnectError):
        httpx.post(f"{site.url}/v1/diffs", content=payloads[0])
    with running(tmp_path / "cloud.db") as site:
        assert site.hand_in(payloads[0]).status_code == 200
