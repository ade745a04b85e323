"""A thousand cars against one service on this machine: rate, delays, memory, CPU.

python -m benchmarks load --minutes 10
python -m benchmarks load --minutes 1 --streets 7 --cars 100 --rate 20
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely

from benchmarks.fleet import Fleet, city_spots

_REQUEST = b"POST /v1/diffs HTTP/1.1\r\nHost: a\r\nContent-Type: application/octet-stream\r\nContent-Length: %d\r\n\r\n"
_TICKS = os.sysconf("SC_CLK_TCK")
WARM_UP_DIFFS = 20
"""Of each car: every block is driven round so often that the service keeps as much of it as it ever will, as in a city
that is in service. The first round is driven at half the rate, every spot is new then."""


@dataclass
class Tally:
    """What the cars saw.

    Attributes:
        sent_at, acknowledged_s, broadcast_s: by the map version that the diff made: when it was sent, seconds on the
            performance counter, and how long until it was acknowledged and until a listener was told.
        statuses: answers by status.
        late: diffs whose car was still waiting for its last answer.
        closed: connections that the service ended before the cars did.
    """

    sent_at: dict[int, float] = field(default_factory=dict)
    acknowledged_s: dict[int, float] = field(default_factory=dict)
    told_at: dict[int, float] = field(default_factory=dict)
    statuses: dict[int, int] = field(default_factory=dict)
    sizes: list[int] = field(default_factory=list)
    late: int = 0
    closed: int = 0

    def broadcast_s(self) -> list[float]:
        return [self.told_at[v] - self.sent_at[v] for v in self.told_at.keys() & self.sent_at.keys()]


class Car(asyncio.Protocol):
    """One connection that hands in one diff at a time."""

    def __init__(self, tally: Tally) -> None:
        self.tally = tally
        self._sent = 0.0
        self._answer = b""
        self.waits = False
        self._transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def connection_lost(self, exc: Exception | None) -> None:
        self.tally.closed += 1

    def hand_in(self, payload: bytes) -> None:
        self.waits, self._answer = True, b""
        self.tally.sizes.append(len(payload))
        self._sent = time.perf_counter()
        self._transport.write(_REQUEST % len(payload) + payload)

    def data_received(self, data: bytes) -> None:
        self._answer += data
        head, end, body = self._answer.partition(b"\r\n\r\n")
        if not end or not body.endswith(b"}"):
            return
        self.waits = False
        status = int(head[9:12])
        self.tally.statuses[status] = self.tally.statuses.get(status, 0) + 1
        if status == 202:
            version = json.loads(body)["map_version"]
            self.tally.sent_at[version] = self._sent
            self.tally.acknowledged_s[version] = time.perf_counter() - self._sent


async def listen(port: int, tally: Tally) -> None:
    """Follow `/changes` and note when each version was told."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 24)
    writer.write(b"GET /changes HTTP/1.1\r\nHost: a\r\nAccept: text/event-stream\r\n\r\n")
    while line := await reader.readline():
        if line.startswith(b"id: "):
            tally.told_at[int(line[4:])] = time.perf_counter()


async def connected(port: int) -> Car:
    """A car; the service lets go of one that does not say anything for ten seconds."""
    _, car = await asyncio.get_running_loop().create_connection(lambda: Car(Tally()), "127.0.0.1", port)
    return car


async def drive(
    cars: dict[int, Car], port: int, fleet: Fleet, first: int, rate: float, seconds: float, tally: Tally
) -> None:
    """Every car hands in its diffs at even intervals, from its `first` one on; it connects when it has one."""
    for known in cars.values():
        known.tally = tally
    sequences = [first] * fleet.cars
    turns = np.random.default_rng(0).permutation(fleet.cars).tolist()  # neighbours are no nearer in time than others
    began, began_at = time.perf_counter(), time.time()
    for number in range(int(rate * seconds)):
        pause = began + number / rate - time.perf_counter()
        if pause > 0:
            await asyncio.sleep(pause)
        car = turns[number % fleet.cars]
        if car not in cars:
            cars[car] = await connected(port)
            cars[car].tally = tally
        if cars[car].waits:
            tally.late += 1
            continue
        cars[car].hand_in(fleet.payload(car, sequences[car], began_at + number / rate))
        sequences[car] += 1


@dataclass
class Usage:
    """What a process has used."""

    cpu_s: dict[str, float]
    resident_mb: float

    @classmethod
    def of(cls, pid: int) -> Usage:
        cpu: dict[str, float] = {}
        for task in Path(f"/proc/{pid}/task").iterdir():
            name = "event loop" if task.name == str(pid) else "intake and others"
            values = task.joinpath("stat").read_text().rpartition(")")[2].split()
            cpu[name] = cpu.get(name, 0.0) + (int(values[11]) + int(values[12])) / _TICKS
        status = Path(f"/proc/{pid}/status").read_text()
        return cls(cpu, int(status.partition("VmRSS:")[2].split()[0]) / 1024)


async def measure(port: int, pid: int, fleet: Fleet, rate: float, seconds: float) -> dict[str, object]:
    """Warm up, then drive for some seconds and watch."""
    cars: dict[int, Car] = {}
    for first, end, pace in ((0, fleet.windows, rate / 2), (fleet.windows, WARM_UP_DIFFS, rate)):
        await drive(cars, port, fleet, first, pace, (end - first) * fleet.cars / pace, Tally())
    tally = Tally()
    listening = asyncio.create_task(listen(port, tally))
    await asyncio.sleep(0.5)
    memory: list[float] = []

    async def watch() -> None:
        while True:
            memory.append(round(Usage.of(pid).resident_mb, 1))
            await asyncio.sleep(max(seconds / 20, 1.0))

    before, own = Usage.of(pid), time.process_time()
    watching = asyncio.create_task(watch())
    await drive(cars, port, fleet, WARM_UP_DIFFS, rate, seconds, tally)
    own = time.process_time() - own
    await asyncio.sleep(2.0)
    after = Usage.of(pid)
    watching.cancel()
    listening.cancel()
    accepted = tally.statuses.get(202, 0)
    used = {name: after.cpu_s[name] - before.cpu_s.get(name, 0.0) for name in after.cpu_s}
    acknowledged, told = list(tally.acknowledged_s.values()), tally.broadcast_s()
    return {
        "diffs_per_s": round(accepted / seconds, 1),
        "statuses": tally.statuses,
        "late": tally.late,
        "closed": tally.closed,
        "diff_bytes_median": int(np.median(tally.sizes)),
        "acknowledged_ms_p50_p99": _percentiles_ms(acknowledged),
        "broadcast_ms_p50_p99": _percentiles_ms(told),
        "resident_mb_start_middle_end": [memory[0], memory[len(memory) // 2], memory[-1]],
        "resident_mb": memory,
        "service_cpu_ms_per_diff": round(1000 * sum(used.values()) / max(accepted, 1), 3),
        "cpu_ms_per_diff_by_thread": {n: round(1000 * s / max(accepted, 1), 3) for n, s in used.items() if s > 0.05},
        "generator_cpu_ms_per_diff": round(1000 * own / max(accepted, 1), 3),
    }


def _percentiles_ms(seconds: list[float]) -> list[float]:
    return [round(1000 * float(p), 1) for p in np.percentile(seconds, (50, 99))] if seconds else []


def write_spots(path: Path, blocks: int) -> int:
    """The city's parking map as a file; returns how many spots it has."""
    parking_map = city_spots(blocks)
    reference = parking_map.georeference
    polygons = shapely.transform(np.array([spot.polygon for spot in parking_map.spots]), reference.to_lon_lat)
    outlines = [json.loads(text) for text in shapely.to_geojson(shapely.force_2d(polygons))]
    spots = [
        {"type": "Feature", "geometry": outline, "properties": {"spot_id": spot.id, "kind": "parallel"}}
        for spot, outline in zip(parking_map.spots, outlines, strict=True)
    ]
    origin = {"lat": reference.lat_deg, "lon": reference.lon_deg, "altitude_m": reference.altitude_m}
    path.write_text(json.dumps({"type": "FeatureCollection", "georeference": origin, "features": spots}))
    return len(spots)


def served(folder: Path, port: int, *options: str) -> subprocess.Popen[bytes]:
    """`autowaze cloud` in a process of its own, ready to take diffs."""
    command = [str(Path(sys.executable).with_name("autowaze")), "cloud", "--open"]
    command += ["--spots", str(folder / "spots.geojson")]
    with (folder / "log").open("ab") as log:
        process = subprocess.Popen([*command, "--port", str(port), *options], stdout=log, stderr=log)
    for _ in range(1800):
        try:
            asyncio.run(_asked(port))
            return process
        except OSError:
            if process.poll() is not None:
                break
            time.sleep(0.1)
    process.kill()
    raise RuntimeError((folder / "log").read_text())


async def _asked(port: int) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(b"GET /ready HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n")
    answer = await reader.read()
    writer.close()
    if not answer.startswith(b"HTTP/1.1 200"):
        raise ConnectionRefusedError(answer)


def run() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser("python -m benchmarks load")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=200.0, help="diffs a second")
    parser.add_argument("--cars", type=int, default=1000)
    parser.add_argument("--streets", type=int, default=1000, help="of 15 spots each")
    parser.add_argument("--store", help="URL of a PostgreSQL database; SQLite if there is none")
    parser.add_argument("--port", type=int, default=18080)
    asked = parser.parse_args(sys.argv[2:])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spots = write_spots(folder / "spots.geojson", asked.streets)
        service = served(folder, asked.port, "--store", asked.store or str(folder / "cloud.db"))
        try:
            fleet = Fleet(asked.cars, asked.streets)
            found = asyncio.run(measure(asked.port, service.pid, fleet, asked.rate, 60 * asked.minutes))
        finally:
            service.send_signal(signal.SIGTERM)
            service.wait(60)
    print(json.dumps({"spots": spots, "cars": asked.cars, "minutes": asked.minutes} | found))
