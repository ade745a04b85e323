"""Diffs by way of real brokers: nothing lost, nothing twice, nobody in another's name."""

import hashlib
import json
import re
import threading
import time
from contextlib import closing, contextmanager, suppress

import paho.mqtt.client as paho
import pytest
from brokers import GuardedMosquitto, GuardedNats, Mosquitto, Nats
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from service_process import geojson_of, serve
from serving import STREET, running

from autowaze.cloud.api.guard import RateLimit
from autowaze.cloud.store import open_store
from autowaze.cloud.store.tokens import Scope, open_tokens
from autowaze.vehicle.mqtt import MqttTransport
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.uplink import Outcome, Uplink
from autowaze.world.acknowledgement import Acknowledgement, Verdict
from autowaze.world.broker import acks_topic, diffs_topic, new_car
from autowaze.world.broker_session import BrokerError, BrokerSession
from autowaze.world.signed_diff import sign_diff

V3, V5 = (MQTTProtocolVersion.MQTTv311,), (MQTTProtocolVersion.MQTTv5,)


@pytest.fixture(params=["mosquitto", "nats"])
def broker(request, tmp_path):
    with started(Mosquitto if request.param == "mosquitto" else Nats, tmp_path) as broker:
        yield broker


@pytest.fixture
def mosquitto(tmp_path):
    with started(Mosquitto, tmp_path) as broker:
        yield broker


@contextmanager
def started(kind, folder, *parts):
    broker = kind(folder, *parts)
    broker.start()
    try:
        yield broker
    finally:
        broker.stop()


@contextmanager
def car(folder, broker, token=None, patience_s=3.0, **options):
    transport = MqttTransport(broker.address, token, patience_s, **options)
    uplink = Uplink(Outbox(folder), transport, lambda: 0.0)
    try:
        yield uplink
    finally:
        uplink.close()


def test_diffs_arrive_in_order_once_and_are_durable_when_acknowledged(broker, tmp_path, passes):
    with running(tmp_path / "cloud.db", broker=broker.address) as site, car(tmp_path / "outbox", broker) as uplink:
        for payload in passes:
            uplink.send(payload)
        assert uplink.flush(30), uplink.trouble
        assert [kept.payload for kept in site.durable.store.log()] == passes


@pytest.mark.parametrize("versions", [V3, V5])
def test_both_versions_of_the_protocol_work(mosquitto, tmp_path, payloads, versions):
    with (
        running(tmp_path / "cloud.db", broker=mosquitto.address) as site,
        car(tmp_path / "outbox", mosquitto, versions=versions) as uplink,
    ):
        for payload in payloads:
            uplink.send(payload)
        assert uplink.flush(20), uplink.trouble
        assert [kept.payload for kept in site.durable.store.log()] == payloads


def test_killing_the_broker_loses_nothing_and_counts_nothing_twice(broker, tmp_path, passes):
    with running(tmp_path / "cloud.db", broker=broker.address) as site:
        with car(tmp_path / "outbox", broker, patience_s=1.0) as uplink:
            for payload in passes:
                uplink.send(payload)
            for kill in (1, 2):
                wait_until(lambda kill=kill: uplink.acknowledged >= kill * len(passes) // 4)
                broker.kill()
                time.sleep(0.3)
                broker.start()
            assert uplink.flush(60), uplink.trouble
            assert uplink.refused == uplink.outbox.dropped == 0
        assert [kept.payload for kept in site.durable.store.log()] == passes


def test_killing_the_service_loses_nothing_and_counts_nothing_twice(mosquitto, tmp_path, passes):
    (tmp_path / "spots.geojson").write_text(json.dumps(geojson_of(STREET.parking_map)))
    process, port = serve(tmp_path, 0, "--mqtt", mosquitto.url)
    try:
        with car(tmp_path / "outbox", mosquitto, patience_s=1.0) as uplink:
            for payload in passes:
                uplink.send(payload)
            for kill in (1, 2):
                wait_until(lambda kill=kill: uplink.acknowledged >= kill * len(passes) // 4, 60)
                acknowledged = uplink.acknowledged
                process.kill()
                process.wait()
                with closing(open_store(tmp_path / "cloud.db")) as kept:
                    assert kept.position >= acknowledged
                process, port = serve(tmp_path, port, "--mqtt", mosquitto.url)
            assert uplink.flush(60), uplink.trouble
            assert uplink.refused == uplink.outbox.dropped == 0
    finally:
        process.terminate()
        process.wait(30)
    with closing(open_store(tmp_path / "cloud.db")) as store:
        assert [kept.payload for kept in store.log()] == passes


def test_diffs_wait_while_only_the_service_is_away(mosquitto, tmp_path, payloads):
    with car(tmp_path / "outbox", mosquitto, patience_s=0.5) as uplink:
        uplink.send(payloads[0])
        assert not uplink.flush(1.0)
        assert "no acknowledgement" in uplink.trouble
        with running(tmp_path / "cloud.db", broker=mosquitto.address):
            assert uplink.flush(20), uplink.trouble


def test_a_refused_diff_does_not_hold_up_the_others(mosquitto, tmp_path, payloads):
    with (
        running(tmp_path / "cloud.db", broker=mosquitto.address),
        car(tmp_path / "outbox", mosquitto) as uplink,
    ):
        for message in (payloads[0], b"nonsense", payloads[1]):
            uplink.send(message)
        assert uplink.flush(20), uplink.trouble
        assert (uplink.acknowledged, uplink.refused) == (2, 1)


def test_only_a_car_with_a_good_token_is_heard_and_its_token_is_never_seen(mosquitto, tmp_path, payloads):
    tokens = open_tokens(tmp_path / "cloud.db")
    secret, other = (tokens.add(name, frozenset({Scope.DIFFS})) for name in ("mine", "other"))
    reader = tokens.add("reader", frozenset({Scope.MAP}))
    overheard = []
    with running(tmp_path / "cloud.db", tokens, broker=mosquitto.address) as site, listening(mosquitto, overheard):
        for token in (None, "awz_wrong", reader):
            with car(tmp_path / "outbox", mosquitto, token, patience_s=0.7) as uplink:
                uplink.send(payloads[0])
                assert not uplink.flush(1.2)
                uplink.outbox.remove(uplink.outbox.first()[0])
        assert site.durable.store.position == 0
        with car(tmp_path / "outbox", mosquitto, secret) as uplink:
            uplink.send(payloads[0])
            assert uplink.flush(20), uplink.trouble
        tokens.revoke("mine")
        with car(tmp_path / "outbox", mosquitto, secret, patience_s=0.7) as uplink:
            uplink.send(payloads[1])
            assert not uplink.flush(1.2)
        assert site.durable.store.position == 1
    everything = b"".join(topic.encode() + payload for topic, payload in overheard)
    assert sum(topic.startswith("autowaze/v1/diffs/") for topic, _ in overheard) >= 5
    assert not any(token.encode() in everything for token in (secret, other, reader))
    tokens.close()


def audited(site):
    return {entry.action for entry in site.durable.store.audit_entries()}


def refusals(site):
    lines = site.client.get("/metrics").text.splitlines()
    found = (re.fullmatch(r'autowaze_diffs_refused_total\{reason="(\w+)"\} (\d+)', line) for line in lines)
    return {match[1]: int(match[2]) for match in found if match}


def test_what_was_overheard_cannot_be_used(mosquitto, tmp_path, payloads):
    tokens = open_tokens(tmp_path / "cloud.db")
    secret = tokens.add("car", frozenset({Scope.DIFFS}))
    with running(tmp_path / "cloud.db", tokens, broker=mosquitto.address) as site:
        signed = sign_diff(payloads[0], "0123456789abcdef", secret)
        altered = signed[: -len(payloads[0])] + payloads[1]
        wait_for_service(mosquitto)
        for topic, message in ((new_car(), signed), ("0123456789abcdef", altered), ("0123456789abcdef", signed[:70])):
            assert answer_to(mosquitto, topic, message)["verdict"] == "later"
        assert site.durable.store.position == 0
        wait_until(lambda: {"diff refused: unauthorized", "diff refused: not_signed"} <= audited(site))
        assert refusals(site)["unauthorized"] >= 2
        assert refusals(site)["not_signed"] >= 1
        assert answer_to(mosquitto, "0123456789abcdef", signed)["verdict"] == "accepted"
        assert answer_to(mosquitto, "0123456789abcdef", signed)["verdict"] == "repeated"
    tokens.close()


@pytest.mark.parametrize("verdict", list(Verdict))
def test_a_car_with_a_token_believes_no_acknowledgement_without_its_seal(mosquitto, payloads, verdict):
    def forge(session, message):
        session.acknowledge(message)
        car = message.topic.rpartition("/")[2]
        diff = bytes(message.payload)[-len(payloads[0]) :]
        session.publish(acks_topic(car), Acknowledgement(sha256_of(diff), verdict).encode(car, b"guess" * 6))

    forger = BrokerSession(mosquitto.address, "forger", ["autowaze/v1/diffs/+"], forge)
    transport = MqttTransport(mosquitto.address, "awz_token", patience_s=0.5)
    answer = transport.hand_in(payloads[0])
    assert answer.outcome is Outcome.LATER
    assert "not sealed" in answer.reason
    transport.close()
    forger.close()


def test_a_car_that_sends_too_much_is_told_to_wait(mosquitto, tmp_path, payloads):
    tokens = open_tokens(tmp_path / "cloud.db")
    secret = tokens.add("car", frozenset({Scope.DIFFS}))
    with running(tmp_path / "cloud.db", tokens, RateLimit(0.1, 1), broker=mosquitto.address):
        transport = MqttTransport(mosquitto.address, secret, patience_s=5.0)
        wait_until(lambda: transport.hand_in(payloads[0]).outcome is Outcome.ACKNOWLEDGED)
        answer = transport.hand_in(payloads[1])
        assert answer.outcome is Outcome.LATER
        assert 1 <= answer.wait_s <= 10
        transport.close()
    tokens.close()


def test_garbage_on_the_topic_of_diffs_does_no_harm(mosquitto, tmp_path, payloads):
    with running(tmp_path / "cloud.db", broker=mosquitto.address), car(tmp_path / "outbox", mosquitto) as uplink:
        wait_for_service(mosquitto)
        noise = BrokerSession(mosquitto.address, "noise", [], lambda session, message: None)
        for size in (0, 1, 100, 1 << 20):
            noise.publish(diffs_topic("aaaaaaaabbbb"), b"x" * size)
            noise.publish(diffs_topic("short"), b"AWM1" + b"\0" * size)
            noise.publish(diffs_topic("retained-" + str(size)), sign_diff(payloads[1], "any", None), retain=True)
        uplink.send(payloads[0])
        assert uplink.flush(20), uplink.trouble
        noise.close()


def test_the_state_of_a_tiles_spots_is_retained_and_follows_the_diffs(broker, tmp_path, payloads):
    documents = {}

    def keep(session, message):
        documents[message.topic] = json.loads(message.payload)
        session.acknowledge(message)

    with running(tmp_path / "cloud.db", broker=broker.address) as site:
        session = BrokerSession(broker.address, new_car(), ["autowaze/v1/spots/17/+/+"], keep)
        wait_until(lambda: spots_in(documents) == dict.fromkeys((f"S{i}" for i in range(12)), "unknown"))
        for payload in payloads:
            site.hand_in(payload)
        wait_until(lambda: [spots_in(documents)[f"S{i}"] for i in (0, 1)] == ["occupied", "vacant"])
        session.close()
        told = {}
        notices = reconnected(broker, lambda session, message: told.update({message.topic: message.payload}), "map")
        versions = {tile: record.version for tile, record in site.durable.service.map.tiles.records.items()}
        expected = {f"autowaze/v1/map/17/{x}/{y}": b'{"version":%d}' % version for (x, y), version in versions.items()}
        wait_until(lambda: told == expected)
        notices.close()
        broker.kill()
        documents.clear()
        broker.start()
        late = reconnected(broker, keep)  # a broker that has forgotten all is told all
        wait_until(lambda: spots_in(documents).get("S1") == "vacant")
        late.close()


# paho leaves the socket of a failed handshake to the garbage collector
@pytest.mark.filterwarnings("ignore:Exception ignored in. <ssl.SSLSocket:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("kind", [GuardedMosquitto, GuardedNats])
def test_a_guarded_broker_lets_cars_hand_in_and_nobody_read_along(tmp_path, payloads, kind, certificate, monkeypatch):
    overheard = []
    with started(kind, tmp_path, certificate) as broker:
        with pytest.raises(BrokerError, match="certificate verify failed"):
            MqttTransport(broker.address_for("car"))._open_session()
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate[0]))
        with running(tmp_path / "c.db", broker=broker.address_for("service")) as site:
            pass_through(broker, site, payloads, kind, overheard)


def pass_through(broker, site, payloads, kind, overheard):
    with pytest.raises(BrokerError, match="refuses the log-in"):
        MqttTransport(broker.address)._open_session()
    spies = []
    for topic in ("autowaze/v1/diffs/+", "#"):
        with suppress(BrokerError):
            spies.append(BrokerSession(broker.address_for("car"), new_car(), [topic], hear(overheard)))
    transport = MqttTransport(broker.address_for("car"), patience_s=5)
    wait_until(lambda: transport.hand_in(payloads[0]).outcome is Outcome.ACKNOWLEDGED)
    assert transport.hand_in(payloads[1]).outcome is Outcome.ACKNOWLEDGED
    forged = BrokerSession(broker.address_for("car"), new_car(), [], hear(overheard))
    forged.publish(acks_topic(transport._car), Acknowledgement(sha256_of(payloads[2]), Verdict.REFUSED).encode())
    forged.publish("autowaze/v1/spots/17/1/1", b"{}", retain=True)
    if kind is GuardedMosquitto:  # it knows a car by its client id
        forged.publish(diffs_topic("of-somebody-else"), sign_diff(payloads[2], "of-somebody-else", None))
    watching = BrokerSession(broker.address_for("car"), new_car(), ["autowaze/v1/spots/17/+/+"], hear(overheard))
    wait_until(lambda: any(b'"S1"' in payload for _, payload in overheard))
    assert transport.hand_in(payloads[1]).outcome is Outcome.ACKNOWLEDGED
    assert site.durable.store.position == 2
    assert not any("/diffs/" in topic or "/spots/17/1/1" in topic for topic, _ in overheard)
    transport.close()
    for session in (*spies, forged, watching):
        session.close()


def hear(overheard):
    def note(session, message):
        overheard.append((message.topic, bytes(message.payload)))
        session.acknowledge(message)

    return note


def reconnected(broker, keep, what="spots"):
    return BrokerSession(broker.address, new_car(), [f"autowaze/v1/{what}/17/+/+"], keep)


def spots_in(documents):
    return {spot["spot_id"]: spot["state"] for document in documents.values() for spot in document["spots"]}


@contextmanager
def listening(broker, overheard):
    """Whoever may read everything."""
    client = paho.Client(CallbackAPIVersion.VERSION2, "eavesdropper")
    ready = threading.Event()
    client.on_message = lambda client, data, message: overheard.append((message.topic, bytes(message.payload)))
    client.on_subscribe = lambda *_: ready.set()
    client.connect("127.0.0.1", broker.port)
    client.subscribe("#")
    client.loop_start()
    assert ready.wait(10)
    try:
        yield
    finally:
        client.disconnect()
        client.loop_stop()


def answer_to(broker, name, message):
    answers = []
    session = BrokerSession(
        broker.address, new_car(), [acks_topic(name)], lambda session, answer: answers.append(answer.payload)
    )
    try:
        session.publish(diffs_topic(name), message)
        wait_until(lambda: answers)
        return json.loads(answers[0])
    finally:
        session.close()


def wait_for_service(broker):
    """Until the service has subscribed: then it retains its spots."""
    retained = []
    session = reconnected(broker, lambda session, message: retained.append(message.topic))
    wait_until(lambda: retained)
    session.close()


def sha256_of(data):
    return hashlib.sha256(data).hexdigest()


def wait_until(condition, timeout_s=20.0):
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)
