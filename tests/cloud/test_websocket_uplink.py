"""Diffs over one WebSocket."""

from contextlib import contextmanager

import pytest
from serving import running
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from autowaze.cloud.api.guard import RateLimit
from autowaze.cloud.store.tokens import Scope, open_tokens
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.transports import public_address, service_address, transport_to
from autowaze.vehicle.uplink import Outcome, Uplink
from autowaze.vehicle.websocket import WebSocketTransport
from autowaze.world.errors import AutowazeError


@contextmanager
def car(folder, url, token=None):
    uplink = Uplink(Outbox(folder), WebSocketTransport(url, token, timeout_s=5), lambda: 0.0)
    try:
        yield uplink
    finally:
        uplink.close()


def address(site):
    return site.url.replace("http", "ws")


def test_diffs_arrive_in_order(site, tmp_path, passes):
    with car(tmp_path / "outbox", address(site)) as uplink:
        for message in [*passes, b"nonsense", passes[0]]:
            uplink.send(message)
        assert uplink.flush(30), uplink.trouble
        assert (uplink.acknowledged, uplink.refused) == (len(passes) + 1, 1)
    assert [kept.payload for kept in site.durable.store.log()] == passes


def test_diffs_wait_while_the_service_is_away(tmp_path, payloads):
    with running(tmp_path / "cloud.db") as site:
        url = address(site)
    port = int(url.rpartition(":")[2])
    with car(tmp_path / "outbox", url) as uplink:
        uplink.send(payloads[0])
        assert not uplink.flush(0.3)
        assert str(port) in uplink.trouble


def test_a_token_is_asked_for_at_every_diff(tmp_path, payloads):
    tokens = open_tokens(tmp_path / "cloud.db")
    secret, reader = tokens.add("car", frozenset({Scope.DIFFS})), tokens.add("reader", frozenset({Scope.MAP}))
    with running(tmp_path / "cloud.db", tokens) as site:
        for token, status in ((None, "401"), ("awz_wrong", "401"), (reader, "403")):
            transport = WebSocketTransport(address(site), token, 5)
            answer = transport.hand_in(payloads[0])
            assert answer.outcome is Outcome.LATER
            assert status in answer.reason
            transport.close()
        transport = WebSocketTransport(address(site), secret, 5)
        assert transport.hand_in(payloads[0]).outcome is Outcome.ACKNOWLEDGED
        tokens.revoke("car")
        answer = transport.hand_in(payloads[1])
        assert answer.outcome is Outcome.LATER
        assert "token" in answer.reason
        transport.close()
        assert site.durable.store.position == 1
    tokens.close()


def test_a_car_that_sends_too_much_is_told_to_wait(tmp_path, payloads):
    tokens = open_tokens(tmp_path / "cloud.db")
    secret = tokens.add("car", frozenset({Scope.DIFFS}))
    with running(tmp_path / "cloud.db", tokens, RateLimit(0.1, 1)) as site:
        transport = WebSocketTransport(address(site), secret, 5)
        assert transport.hand_in(payloads[0]).outcome is Outcome.ACKNOWLEDGED
        assert transport.hand_in(payloads[1]).wait_s >= 1
        transport.close()
    tokens.close()


def test_what_is_no_diff_closes_the_connection_or_is_refused(site):
    url = f"{address(site)}/v1/diffs/ws"
    for message in ("text", b"x" * ((1 << 20) + 1)):
        with connect(url) as socket:
            socket.send(message)
            with pytest.raises(ConnectionClosed):
                socket.recv(5)
    with connect(url) as socket:
        socket.send(b"")
        assert b'"refused"' in socket.recv(5)
    with pytest.raises(InvalidStatus), connect(f"{address(site)}/v1/nothing/ws"):
        pass


def test_an_address_names_its_transport():
    assert public_address("mqtts://car:secret@broker.example") == "mqtts://broker.example:8883"
    assert service_address("wss://parking.example") == "https://parking.example"
    assert service_address("mqtt://broker.example", "https://parking.example") == "https://parking.example"
    with pytest.raises(AutowazeError, match="--service"):
        service_address("mqtt://broker.example")
    for url in ("mqtt://", "mqtt://broker/topic", "mqtt://broker:port", "ftp://parking.example"):
        with pytest.raises(AutowazeError, match="not the URL"):
            transport_to(url, None)
