"""Connections that dawdle or crowd, TLS, and a hundred thousand spoilt diffs."""

import os
import socket
import ssl
import threading
import time
import tracemalloc
from dataclasses import replace

import httpx
import numpy as np
import pytest
from serving import NOW, STREET, running

from autowaze.cloud.admission import CarefulAdmission
from autowaze.cloud.api import create_app
from autowaze.cloud.api.connections import MOST_HEAD_BYTES, BoundedProtocol
from autowaze.cloud.api.guard import Guard, RateLimit
from autowaze.cloud.api.problems import ProblemError
from autowaze.cloud.api.server import WebServer, listening_socket
from autowaze.cloud.durable import DurableService
from autowaze.cloud.passes import PassJournal
from autowaze.cloud.service import CloudService
from autowaze.cloud.store import SqliteStore, open_tokens
from autowaze.cloud.store.tokens import Scope
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.errors import AutowazeError, WireError
from autowaze.world.wire import encode_diff


def dialled(site):
    host, port = site.url.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), timeout=10)


def is_closed(connection):
    connection.settimeout(10)
    try:
        while connection.recv(1 << 16):
            pass
    except ConnectionResetError:
        pass
    return True


def test_a_head_that_comes_too_slowly_is_not_waited_for(monkeypatch, site, payloads):
    monkeypatch.setattr(BoundedProtocol, "patience_s", 0.5)
    with dialled(site) as silent, dialled(site) as slow:
        slow.sendall(b"POST /v1/diffs HTTP/1.1\r\nHost: a\r\nX-A: ")
        began = time.monotonic()
        assert is_closed(silent)
        assert is_closed(slow)
        assert time.monotonic() - began < 8.0
    assert site.hand_in(payloads[0]).status_code == 202


def test_a_second_head_is_not_waited_for_either(monkeypatch, site):
    monkeypatch.setattr(BoundedProtocol, "patience_s", 0.5)
    with dialled(site) as connection:
        connection.sendall(b"GET /health HTTP/1.1\r\nHost: a\r\n\r\n")
        assert connection.recv(1 << 16).startswith(b"HTTP/1.1 200")
        connection.sendall(b"GET /health HTTP/1.1\r\n")
        assert is_closed(connection)


def test_a_head_without_end_is_cut_off(site):
    with dialled(site) as connection:
        connection.sendall(b"GET /health HTTP/1.1\r\nHost: a\r\n")
        line = b"X-Padding: " + b"a" * 1000 + b"\r\n"
        with pytest.raises((ConnectionResetError, BrokenPipeError)):
            for _ in range(100 * MOST_HEAD_BYTES // len(line)):
                connection.sendall(line)
        assert site.client.get("/health").status_code == 200


def test_one_address_gets_so_many_connections(monkeypatch, site):
    monkeypatch.setattr(BoundedProtocol, "spared", ())
    monkeypatch.setattr(BoundedProtocol, "most_per_address", 3)
    connections = [dialled(site) for _ in range(6)]
    try:
        answers = []
        for connection in connections:
            try:
                connection.sendall(b"GET /health HTTP/1.1\r\nHost: a\r\n\r\n")
                answers.append(connection.recv(100).startswith(b"HTTP/1.1 200"))
            except (ConnectionResetError, BrokenPipeError):
                answers.append(False)
        assert answers == [True] * 3 + [False] * 3
    finally:
        for connection in connections:
            connection.close()


def test_so_many_bytes_a_day(tmp_path, payloads):
    tokens = open_tokens(tmp_path / "cloud.db")
    secret = tokens.add("car", frozenset({Scope.DIFFS}))
    with running(tmp_path / "cloud.db", tokens, RateLimit(bytes_per_day=len(payloads[0]) + 10)) as site:
        sent = [site.hand_in(payload, Authorization=f"Bearer {secret}") for payload in payloads[:2]]
        assert [response.status_code for response in sent] == [202, 429]
        assert sent[1].json()["error"] == "too_many_bytes"
    clock = [0.0]
    guard = Guard(tokens, RateLimit(bytes_per_day=10), lambda: clock[0])
    guard.count_bytes("car", 10)
    with pytest.raises(ProblemError):
        guard.count_bytes("car", 1)
    clock[0] = 86_400.0
    guard.count_bytes("car", 10)
    tokens.close()


def test_the_service_speaks_tls(tmp_path, payloads, certificate):
    store = SqliteStore(tmp_path / "cloud.db")
    durable = DurableService(lambda: CloudService(STREET.parking_map), store, lambda: NOW)
    app = create_app(durable, STREET.parking_map, Guard(None), None, PassJournal())
    listening = listening_socket("127.0.0.1", 0)
    port = listening.getsockname()[1]
    server = WebServer(app, *certificate)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        trusted = ssl.create_default_context(cafile=str(certificate[0]))
        with httpx.Client(base_url=f"https://localhost:{port}", verify=trusted) as client:
            answer = client.post("/v1/diffs", content=payloads[0], headers={"Content-Type": "application/octet-stream"})
            assert answer.status_code == 202
        with pytest.raises(httpx.ConnectError):
            httpx.get(f"https://localhost:{port}/health")
        old = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        old.check_hostname, old.verify_mode = False, ssl.CERT_NONE
        with pytest.warns(DeprecationWarning):
            old.maximum_version = ssl.TLSVersion.TLSv1_1
        with pytest.raises(httpx.ConnectError):
            httpx.get(f"https://localhost:{port}/health", verify=old)
    finally:
        server.stop()
        thread.join(20)
        store.close()


def test_tls_needs_a_certificate_and_its_key(certificate):
    with pytest.raises(AutowazeError, match="both"):
        WebServer(None, certificate[0])


def spoilt(diff, payload, rng):
    """Bytes that were hit in a few places, or a true diff one value of which is not."""
    if rng.random() < 0.7:
        mutated = bytearray(payload)
        for place in rng.integers(0, len(mutated), rng.integers(1, 6)):
            mutated[place] = rng.integers(0, 256)
        return bytes(mutated[: rng.integers(1, len(mutated) + 1)] if rng.random() < 0.1 else mutated)
    values = {
        "end": diff.start + 3600.0 * rng.random(),
        "frames": int(rng.integers(diff.localized_frames, 1 << 31)),
        "position_sigma_m": 10.0 ** rng.uniform(-2, 6),
        "sequence": int(rng.integers(0, 4096)),
        "session": int(rng.integers(0, 1 << 39)),
    }
    column = rng.choice(list(values))
    return encode_diff(replace(diff, **{column: values[column]}))


@pytest.mark.parametrize("count", [int(os.environ.get("AUTOWAZE_SPOILT_DIFFS", "1500"))])
def test_spoilt_diffs_are_refused_and_leave_nothing_behind(tmp_path, diffs, count):
    small = replace(diffs[1], ground=diffs[1].ground[:200], new=diffs[1].new[:0], instances=diffs[1].instances[:0])
    payload = encode_diff(small)
    service = DurableService(
        lambda: CloudService(STREET.parking_map), SqliteStore(tmp_path / "a.db"), lambda: NOW, CarefulAdmission()
    )
    rng = np.random.default_rng(5)
    reasons, taken = set(), 0
    tracemalloc.start()
    for number in range(count):
        try:
            taken += service.receive(spoilt(small, payload, rng), "mallory").accepted
        except RefusedDiffError as error:
            reasons.add(error.reason)
        except WireError:
            reasons.add("no diff")
        if number == count // 3:
            before, _ = tracemalloc.get_traced_memory()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "no diff" in reasons
    assert len(reasons & {"replayed", "back_dated", "too_many_frames", "unsure", "too_long", "numbering"}) >= 4
    assert after - before < (16 << 20) + 40_000 * taken
    assert service.receive(encode_diff(replace(diffs[0], session=2, new=diffs[0].new[:0]))).accepted
