"""Five cars, ten minutes without network, at a clock that the test turns: all caught up, nothing lost, in order."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from brokers import Mosquitto, Nats
from serving import running

from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.mqtt import MqttTransport
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.uplink import LONGEST_WAIT_S, HttpTransport, Uplink
from autowaze.vehicle.websocket import WebSocketTransport
from fleet import WINDOW_S, Fleet

CARS, CUT_S = 5, 600.0
BEFORE_S, PATIENCE_S = 30.0, 5.0


class Wire:
    """A transport over a network that can be cut; what is under way when it is cut arrives, its answer does not."""

    def __init__(self, transport, cut):
        self._transport, self._cut = transport, cut

    def hand_in(self, message):
        if self._cut.is_set:
            raise OSError("no network")
        answer = self._transport.hand_in(message)
        if self._cut.swallow_answers:
            raise OSError("the network went while the service answered")
        return answer

    def close(self):
        self._transport.close()


class Cut:
    is_set = swallow_answers = False


@pytest.mark.parametrize("way", ["http", "websocket", "mosquitto", "nats"])
def test_all_catch_up_after_ten_minutes_without_network(tmp_path, way):
    cut, rng = Cut(), random.Random(0)
    broker = {"mosquitto": Mosquitto, "nats": Nats}.get(way, lambda folder: None)(tmp_path)
    if broker:
        broker.start()
    try:
        with running(tmp_path / "cloud.db", broker=broker and broker.address) as site:
            transports = [Wire(transport(way, site, broker), cut) for _ in range(CARS)]
            fleet = Fleet(tmp_path, transports, rng.random)
            fleet.run(BEFORE_S)
            cut.swallow_answers = True
            fleet.run(BEFORE_S + WINDOW_S)
            cut.is_set, cut.swallow_answers = True, False
            fleet.run(BEFORE_S + CUT_S)
            waiting = [len(car.delivery.outbox) for car in fleet.cars]
            assert min(waiting) >= CUT_S // WINDOW_S
            cut.is_set = False
            if broker:
                broker.kill()
                broker.start()
            fleet.run(BEFORE_S + CUT_S + 2 * LONGEST_WAIT_S)
            deadline = time.monotonic() + 60
            while not fleet.caught_up() and time.monotonic() < deadline:
                fleet.run(fleet.now + LONGEST_WAIT_S, driving=False)
            assert fleet.caught_up(), [car.delivery.trouble for car in fleet.cars]
            kept = list(site.durable.store.log())
        for number, car in enumerate(fleet.cars, start=1):
            assert [diff.payload for diff in kept if diff.session == number] == car.made
            assert car.delivery.refused == car.delivery.outbox.dropped == 0
            tried = sum(BEFORE_S + WINDOW_S < t < BEFORE_S + CUT_S for t in car.attempts)
            assert tried <= 9 + CUT_S / (LONGEST_WAIT_S / 2)  # nobody knocks all the time
        comeback = [min(t for t in car.attempts if t > BEFORE_S + CUT_S) for car in fleet.cars]
        assert max(comeback) - min(comeback) > 2.0  # nor all at once
        fleet.close()
    finally:
        if broker:
            broker.stop()


def transport(way, site, broker):
    if way == "http":
        return HttpTransport(CloudConnection(site.url, timeout_s=PATIENCE_S))
    if way == "websocket":
        return WebSocketTransport(site.url.replace("http", "ws"), timeout_s=PATIENCE_S)
    return MqttTransport(broker.address, patience_s=PATIENCE_S)


CAR = """
import sys
from pathlib import Path
from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.uplink import HttpTransport, Uplink

folder, url, messages = sys.argv[1:]
uplink = Uplink(Outbox(folder), HttpTransport(CloudConnection(url, timeout_s=5)), lambda: 0.0)
for path in sorted(Path(messages).iterdir()):
    uplink.send(path.read_bytes())
    print(path.name, flush=True)
uplink.flush(60)
"""


def test_kill_9_of_the_car_loses_nothing_that_it_kept(site, tmp_path, passes):
    messages = tmp_path / "messages"
    messages.mkdir()
    for number, payload in enumerate(passes):
        (messages / f"{number:04d}").write_bytes(payload)
    kept = 0
    for kill in (1, 2):
        car = subprocess.Popen(
            [sys.executable, "-c", CAR, tmp_path / "outbox", site.url, messages], stdout=subprocess.PIPE, text=True
        )
        for _ in range(kill * len(passes) // 3):
            kept = max(kept, int(car.stdout.readline()))
        os.kill(car.pid, signal.SIGKILL)
        car.wait()
        car.stdout.close()
    partial = list(Path(tmp_path / "outbox").glob("*.partial"))
    assert len(partial) <= 1
    uplink = Uplink(Outbox(tmp_path / "outbox"), HttpTransport(CloudConnection(site.url, timeout_s=5)), lambda: 0.0)
    assert uplink.flush(30), uplink.trouble
    uplink.close()
    arrived = [diff.payload for diff in site.durable.store.log()]
    assert arrived[: kept + 1] == passes[: kept + 1]
    assert len(arrived) == len(set(arrived))
    assert not list(Path(tmp_path / "outbox").glob("*.partial"))
