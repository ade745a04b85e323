"""Damaged diffs against the ingest endpoint: each gets an answer, the service lives, its memory stays flat.

python -m benchmarks mutated --count 100000
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import zstandard

from autowaze.world import wire_pb2 as pb
from benchmarks.fleet import Fleet
from benchmarks.load import Usage, served, write_spots

CONNECTIONS = 16
STREETS = 20
_REQUEST = b"POST /v1/diffs HTTP/1.1\r\nHost: a\r\nContent-Type: application/octet-stream\r\nContent-Length: %d\r\n\r\n"


def mutated(count: int, seed: int = 0) -> Iterator[bytes]:
    """Real diffs with damage: half of it to the envelope and its zstd frame, half to the message inside."""
    rng = np.random.default_rng(seed)
    fleet, sound, now = Fleet(STREETS, STREETS), [], time.time()
    for car in range(STREETS):
        envelope = pb.Envelope()
        payload = fleet.payload(car, car % 6, now)
        envelope.ParseFromString(payload)
        sound.append((payload, zstandard.decompress(envelope.body)))
    compressor = zstandard.ZstdCompressor(level=1)
    for number in range(count):
        payload, body = sound[number % STREETS]
        if number % 2:
            yield _damaged(payload, rng)
        else:
            packed = compressor.compress(_damaged(body, rng))
            yield pb.Envelope(version=1, body=packed).SerializeToString()


def _damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes changed, cut out, or repeated."""
    hurt = bytearray(data)
    for _ in range(int(rng.integers(1, 8))):
        start, kind = int(rng.integers(0, len(hurt))), rng.integers(0, 4)
        length = int(rng.integers(1, 32))
        if kind <= 1:
            hurt[start] = int(rng.integers(0, 256))
        elif kind == 2 and len(hurt) > 64:
            del hurt[start : start + length]
        else:
            hurt[start:start] = hurt[start : start + length]
    return bytes(hurt)


async def hand_in(port: int, payloads: Iterator[bytes], statuses: Counter[str]) -> None:
    """Hand in what is left of the payloads over one connection, one after the other; open another if it is closed."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    for payload in payloads:
        status = ""
        while status in ("", "429", "503"):
            try:
                status = await _answered(reader, writer, payload)
            except (OSError, asyncio.IncompleteReadError):
                statuses["closed"] += 1
                writer.close()
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
        statuses[status] += 1
    writer.close()


async def _answered(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, payload: bytes) -> str:
    writer.write(_REQUEST % len(payload) + payload)
    head = await reader.readuntil(b"\r\n\r\n")
    length = next(int(line[15:]) for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:"))
    await reader.readexactly(length)
    return head[9:12].decode()


async def measure(port: int, pid: int, count: int) -> dict[str, object]:
    """Hand them in over several connections at once and watch the memory."""
    statuses: Counter[str] = Counter()
    payloads = mutated(count)
    memory = []

    async def watch() -> None:
        while True:
            memory.append(round(Usage.of(pid).resident_mb))
            await asyncio.sleep(5.0)

    watching = asyncio.create_task(watch())
    await asyncio.gather(*(hand_in(port, payloads, statuses) for _ in range(CONNECTIONS)))
    watching.cancel()
    return {"mutated": count, "statuses": dict(sorted(statuses.items())), "resident_mb": memory}


def run() -> None:
    """Print one JSON object; fails if the service crashed."""
    parser = argparse.ArgumentParser("python -m benchmarks mutated")
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--port", type=int, default=18082)
    asked = parser.parse_args(sys.argv[2:])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_spots(folder / "spots.geojson", STREETS)
        service = served(folder, asked.port, "--store", str(folder / "cloud.db"))
        try:
            found = asyncio.run(measure(asked.port, service.pid, asked.count))
            if service.poll() is not None:
                raise RuntimeError((folder / "log").read_text())
            failures = (folder / "log").read_text().count("Traceback")
        finally:
            service.send_signal(signal.SIGTERM)
            service.wait(60)
    print(json.dumps(found | {"failures_logged": failures}))
