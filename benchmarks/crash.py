"""kill -9 of the service under load: what it acknowledged is there afterwards, once, and the spots are right.

python -m benchmarks crash --kills 20
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from autowaze.cloud.durable import DurableService
from autowaze.cloud.service import CloudService
from autowaze.cloud.store import open_store
from autowaze.world.parking import ParkingMap
from benchmarks.fleet import Fleet
from benchmarks.load import served, write_spots

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cloud"))
from postgres_server import PostgresServer
from street import WINDOW_S

CARS, STREETS = 40, 40
HELD_BACK_S = 6 * 3600.0
"""The outboxes are that old, so that windows can follow each other faster than time goes by."""
_REQUEST = b"POST /v1/diffs HTTP/1.1\r\nHost: a\r\nContent-Type: application/octet-stream\r\nContent-Length: %d\r\n\r\n"


class Sender:
    """A car with an outbox in memory: it sends one diff until that is acknowledged, then the next.

    Attributes:
        acknowledged: keys (session, sequence) of diffs that the service said it has.
    """

    def __init__(self, car: int, fleet: Fleet, port: int, acknowledged: set[tuple[int, int]]) -> None:
        self._car, self._fleet, self._port = car, fleet, port
        self._acknowledged = acknowledged
        self._sequence = 0
        self._began = time.time() - HELD_BACK_S
        self._payload: bytes | None = None

    async def send_for_ever(self) -> None:
        while True:
            try:
                reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
            except OSError:
                await asyncio.sleep(0.05)
                continue
            try:
                while True:
                    await self._send(reader, writer)
            except (OSError, asyncio.IncompleteReadError):
                await asyncio.sleep(0.02)
            finally:
                writer.close()

    async def _send(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._payload is None:
            self._payload = self._fleet.payload(self._car, self._sequence, self._began + self._sequence * WINDOW_S)
        writer.write(_REQUEST % len(self._payload) + self._payload)
        head = await reader.readuntil(b"\r\n\r\n")
        length = next(int(line[15:]) for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:"))
        body = await reader.readexactly(length)
        if head[9:12] not in (b"200", b"202"):
            if not head.startswith((b"HTTP/1.1 503", b"HTTP/1.1 429")):
                raise RuntimeError(f"refused: {body!r}")
            await asyncio.sleep(0.2)
            return
        self._acknowledged.add((1 + self._car, self._sequence))
        self._payload = None
        self._sequence += 1


async def _under_load(
    senders: list[Sender], acknowledged: set[tuple[int, int]], process: subprocess.Popen[bytes], seconds: float
) -> None:
    """Kill the service so many seconds after it has taken each car's diff, on average."""
    sending = [asyncio.create_task(sender.send_for_ever()) for sender in senders]
    before = len(acknowledged)
    while len(acknowledged) < before + CARS and not any(task.done() for task in sending):
        await asyncio.sleep(0.01)
    await asyncio.sleep(seconds)
    process.send_signal(signal.SIGKILL)
    process.wait()
    for task in sending:
        task.cancel()
    for result in await asyncio.gather(*sending, return_exceptions=True):
        if not isinstance(result, asyncio.CancelledError):
            raise RuntimeError("a car gave up") from result


def killed(address: str, kills: int, port: int, snapshots: bool = True) -> dict[str, object]:
    """Kill the service so often, then compare what its store holds with what it acknowledged.

    Args:
        address: of an empty store.
        snapshots: keep one at every second start, so that starts come from snapshots, too.
    """
    rng = np.random.default_rng(0)
    acknowledged: set[tuple[int, int]] = set()
    fleet = Fleet(CARS, STREETS)
    senders = [Sender(car, fleet, port, acknowledged) for car in range(CARS)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_spots(folder / "spots.geojson", STREETS)
        spots = ParkingMap.from_geojson(folder / "spots.geojson")
        for number in range(kills):
            process = served(folder, port, "--store", address)
            asyncio.run(_under_load(senders, acknowledged, process, float(rng.uniform(0.0, 1.0))))
            if snapshots and number % 2:
                durable = DurableService(lambda: CloudService(spots), open_store(address))
                durable.snapshot()
                durable.store.close()
        store = open_store(address)
        log = [(accepted.session, accepted.sequence) for accepted in store.log()]
        undisturbed = CloudService(spots)
        for accepted in store.log():
            undisturbed.receive(accepted.payload)
        kept = {state.spot_id: state for state in store.spots()}
        store.close()
    expected = {state.spot_id: state for state in undisturbed.states if state.observed_at is not None}
    return {
        "kills": kills,
        "acknowledged": len(acknowledged),
        "in_the_log": len(log),
        "lost": len(acknowledged - set(log)),
        "counted_twice": sum(count - 1 for count in Counter(log).values()),
        "spots": len(kept),
        "spots_that_differ": sum(kept.get(spot) != expected.get(spot) for spot in kept.keys() | expected.keys()),
    }


@contextmanager
def addresses() -> Iterator[dict[str, str]]:
    """An empty store of each kind, durable as in operation."""
    server = PostgresServer(durable=True)
    try:
        with tempfile.TemporaryDirectory() as folder:
            yield {"sqlite": str(Path(folder) / "cloud.db"), "postgres": server.make("crash")}
    finally:
        server.remove()


def run() -> None:
    """Print one JSON object per kind of store."""
    parser = argparse.ArgumentParser("python -m benchmarks crash")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--port", type=int, default=18081)
    asked = parser.parse_args(sys.argv[2:])
    with addresses() as stores:
        for kind, address in stores.items():
            print(json.dumps({"store": kind} | killed(address, asked.kills, asked.port)), flush=True)
