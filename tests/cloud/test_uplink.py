"""Cars and the service together: nothing is lost, whatever happens to either or to the network between."""

import json
import os
import signal
import socket
import threading
import time
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import numpy as np
import pytest
from service_process import geojson_of, serve
from serving import STREET, running

from autowaze.cli.remote_drive import (
    RemoteCloud,
    downlink_from,
    first_map,
    in_the_services_frame,
    show_arrivals,
    uplink_to,
)
from autowaze.cloud.service import CloudService
from autowaze.cloud.store import SqliteStore
from autowaze.cloud.store.tokens import Scope, TokenRegister
from autowaze.vehicle.connection import CloudConnection, UnreachableError
from autowaze.vehicle.downlink import brought_up_to_date, fetch_map
from autowaze.vehicle.node import StartingPoint
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.uplink import HttpTransport, Outcome, Uplink
from autowaze.world.errors import AutowazeError
from autowaze.world.frame import GnssFix
from autowaze.world.parking import ParkingMap

KILLS = 2


@contextmanager
def car(folder, url, token=None):
    uplink = Uplink(Outbox(folder), HttpTransport(CloudConnection(url, token, timeout_s=5)), lambda: 0.0)
    try:
        yield uplink
    finally:
        uplink.close()


def test_a_car_hands_in_its_diffs_in_order(site, tmp_path, payloads):
    with car(tmp_path / "outbox", site.url) as uplink:
        for payload in payloads:
            uplink.send(payload)
        assert uplink.flush(10)
        assert uplink.acknowledged == len(payloads)
    assert [kept.payload for kept in site.durable.store.log()] == payloads


def test_diffs_wait_on_disk_until_there_is_a_service_again(tmp_path, payloads):
    with running(tmp_path / "cloud.db") as site:
        url = site.url
    with car(tmp_path / "outbox", url) as uplink:
        for payload in payloads:
            uplink.send(payload)
        assert not uplink.flush(0.3)
        assert "refused" in uplink.trouble
    with running(tmp_path / "cloud.db") as site, car(tmp_path / "outbox", site.url) as uplink:
        assert uplink.flush(10)
        assert [kept.payload for kept in site.durable.store.log()] == payloads


def test_a_refused_diff_does_not_hold_up_the_others(site, tmp_path, payloads):
    with car(tmp_path / "outbox", site.url) as uplink:
        for message in (payloads[0], b"nonsense", payloads[1]):
            uplink.send(message)
        assert uplink.flush(10)
        assert (uplink.acknowledged, uplink.refused) == (2, 1)
    assert [path.read_bytes() for path in (tmp_path / "outbox" / "refused").iterdir()] == [b"nonsense"]


def test_a_car_without_good_token_keeps_its_diffs(tmp_path, payloads):
    tokens = TokenRegister(tmp_path / "cloud.db")
    secret = tokens.add("car", frozenset({Scope.DIFFS}))
    with running(tmp_path / "cloud.db", tokens) as site:
        with car(tmp_path / "outbox", site.url, "awz_wrong") as uplink:
            uplink.send(payloads[0])
            assert not uplink.flush(0.3)
            assert "401" in uplink.trouble
        with car(tmp_path / "outbox", site.url, secret) as uplink:
            assert uplink.flush(10)
        with CloudConnection(site.url, secret) as connection, pytest.raises(AutowazeError, match="scope map"):
            fetch_map(connection)
    tokens.close()


@pytest.mark.parametrize(
    ("status", "body"),
    [
        (200, b"<html>Welcome to the hotel's wireless network</html>"),
        (200, b'{"accepted":true,"sha256":"of something else"}'),
        (404, b'{"error":"not_found"}'),
        (400, b"<html>bad gateway</html>"),
        (503, b""),
        (200, b"[" * 60_000),
        (200, b"x" * 100_000),
        (302, b""),
    ],
)
def test_only_the_service_itself_can_acknowledge_or_refuse(status, body):
    class Portal(BaseHTTPRequestHandler):
        def do_POST(self):
            self.rfile.read(int(self.headers["Content-Length"]))
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *args):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Portal)
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}).start()
    try:
        with CloudConnection(f"http://127.0.0.1:{server.server_port}") as connection:
            assert HttpTransport(connection).hand_in(b"a diff").outcome is Outcome.LATER
    finally:
        server.shutdown()
        server.server_close()


def test_a_connection_that_the_service_let_go_of_is_opened_again():
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def answer_one_request_per_connection():
            for _ in range(2):
                connection, _ = listening.accept()
                with connection:
                    connection.recv(4096)
                    connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nok")

        service = threading.Thread(target=answer_one_request_per_connection)
        service.start()
        with CloudConnection(f"http://127.0.0.1:{listening.getsockname()[1]}") as connection:
            assert connection.get("/").body == b"ok"
            time.sleep(0.2)
            assert connection.post("/v1/diffs", b"diff").body == b"ok"
        service.join()


def test_a_car_follows_the_services_map(site, payloads):
    with CloudConnection(site.url) as connection:
        stored = fetch_map(connection)
        site.hand_in(payloads[0])
        stored = brought_up_to_date(stored, connection)
        for payload in payloads[1:]:
            site.hand_in(payload)
        stored = brought_up_to_date(stored, connection)
        assert stored.version == len(payloads)
        assert stored.features.id.tolist() == site.durable.service.feature_map.features.id.tolist()
        stored.version = 999
        assert brought_up_to_date(stored, connection).version == len(payloads)


def test_a_drive_sends_to_the_service_in_its_map_frame_and_follows_it(site, tmp_path, payloads, capsys):
    remote = RemoteCloud(site.url.replace("http", "ws"))
    for fix in (None, GnssFix(-73.0, 40.0)):
        stored = first_map(remote, [SimpleNamespace(gnss=fix)])
        start = in_the_services_frame(StartingPoint(), stored)
        assert start.georeference == site.street.parking_map.georeference
    with uplink_to(remote, tmp_path / "outbox") as uplink, downlink_from(remote, stored) as downlink:
        for payload in payloads:
            uplink.send(payload)
        assert uplink.flush(20)
        show_arrivals(downlink.arrivals(np.zeros(3)))
        assert downlink.settle(10)
        show_arrivals(downlink.arrivals(np.zeros(3)))
    shown = capsys.readouterr().out
    assert f"{len(payloads)} diffs acknowledged, 0 refused" in shown
    assert f"map {len(payloads)}: +" in shown
    assert "free near here: S" in shown


@pytest.mark.parametrize("url", ["parking.example", "ftp://parking.example", "http://", "http://a:port"])
def test_what_is_no_url_is_named(url):
    with pytest.raises(AutowazeError, match="not the URL"):
        CloudConnection(url)


def test_an_unreachable_service_is_named():
    with pytest.raises(UnreachableError, match=r"127\.0\.0\.1:9/map"):
        fetch_map(CloudConnection("http://127.0.0.1:9"))


def test_kill_9_while_a_car_uploads_loses_nothing_and_counts_nothing_twice(tmp_path, passes):
    spots = geojson_of(STREET.parking_map)
    (tmp_path / "spots.geojson").write_text(json.dumps(spots))
    process, port = serve(tmp_path, 0)
    with car(tmp_path / "outbox", f"http://127.0.0.1:{port}") as uplink:
        for payload in passes:
            uplink.send(payload)
        for kill in range(1, KILLS + 1):
            wait_for_acknowledged(uplink, kill * len(passes) // (KILLS + 2))
            acknowledged = uplink.acknowledged
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            kept = SqliteStore(tmp_path / "cloud.db")
            assert kept.position >= acknowledged
            kept.close()
            process, _ = serve(tmp_path, port)
        assert uplink.flush(30)
        assert uplink.refused == uplink.outbox.dropped == 0
    process.terminate()
    assert process.wait(15) in (0, -signal.SIGTERM)
    store = SqliteStore(tmp_path / "cloud.db")
    assert [kept.payload for kept in store.log()] == passes
    alone = CloudService(ParkingMap.from_geojson(tmp_path / "spots.geojson"))
    for payload in passes:
        alone.receive(payload)
    known = {state.spot_id: state for state in alone.states if state.observed_at is not None}
    assert {state.spot_id: state for state in store.spots()} == known
    store.close()


def wait_for_acknowledged(uplink, enough, timeout_s=20.0):
    deadline = time.monotonic() + timeout_s
    while uplink.acknowledged < enough:
        assert time.monotonic() < deadline, uplink.trouble
        time.sleep(0.005)
