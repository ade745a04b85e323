"""Processes that render, survey and drive: one per street, so that each street is built once."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

from autowaze.evaluation import base_map
from autowaze.evaluation.demonstration.city import surveyed_start
from autowaze.evaluation.drive import DriveRecord, run_drive
from autowaze.evaluation.latency import latency_metrics
from autowaze.evaluation.network import network_metrics
from autowaze.simulator import StreetDescription, record
from autowaze.traces import open_trace
from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.downlink import LiveDownlink, fetch_map_around
from autowaze.vehicle.node import StartingPoint, VehicleNode
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.semantics.no_segmentation import NoSegmentation
from autowaze.vehicle.semantics.segmenter import Segmenter, load_segmenter
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.vehicle.spot_follower import fetch_spots
from autowaze.vehicle.tile_follower import TileFollower
from autowaze.vehicle.uplink import HttpTransport, Uplink
from autowaze.world.errors import AutowazeError
from autowaze.world.frame import StereoFrame
from autowaze.world.georeference import Georeference
from autowaze.world.map_file import load_map
from autowaze.world.parking import ParkingMap
from autowaze.world.wire import encode_diff

Tell = Callable[[str, int, int], None]
"""Called with what is done, and how many of how many frames are."""
_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")
_PATIENCE_S = 60.0
_REHEARSED_FRAMES = 12


@dataclass(frozen=True)
class CarReport:
    """What a car's drive left behind.

    Attributes:
        tracked: one per frame.
        diff_bytes: size of each diff, and `end_to_end_ms` from the last frame of its window until it was acknowledged.
        refused: how many of them the service did not take.
        metrics: its latency and network figures.
    """

    tracked: list[TrackedFrame]
    distance_m: float
    diff_bytes: list[int]
    end_to_end_ms: list[float]
    refused: int
    metrics: dict[str, float]


class Crews:
    """One process per street.

    Args:
        streets: how many.
        tell: is told of the progress, in a thread of its own.
    """

    def __init__(self, streets: int, tell: Tell) -> None:
        context = multiprocessing.get_context("spawn")
        self._told: SimpleQueue[tuple[str, int, int] | None] = context.SimpleQueue()
        self._pools = [ProcessPoolExecutor(1, context, _begin, (self._told,)) for _ in range(streets)]
        self._listener = threading.Thread(target=self._listen, args=(tell,), daemon=True)
        self._listener.start()

    def submit(
        self, street: int, job: Callable[_Parameters, _Result], *args: _Parameters.args, **kwargs: _Parameters.kwargs
    ) -> Future[_Result]:
        """Let the crew of a street do a job, after what it has to do already."""
        return self._pools[street % len(self._pools)].submit(job, *args, **kwargs)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait for the crews; after an error, and after Ctrl-C, stop them."""
        if kind is not None:
            for process in multiprocessing.active_children():
                process.terminate()
        for pool in self._pools:
            pool.shutdown(cancel_futures=True)
        self._told.put(None)
        self._listener.join()

    def _listen(self, tell: Tell) -> None:
        while (news := self._told.get()) is not None:
            tell(*news)


_told: SimpleQueue[Any]


def _begin(told: SimpleQueue[Any]) -> None:
    global _told  # noqa: PLW0603 - a process of the pool tells one listener of all its jobs
    _told = told
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process of the terminal


def render(description: StreetDescription, folder: Path, name: str) -> None:
    """Simulate a drive; what is in the folder already is kept."""
    workers = max(1, (os.cpu_count() or 1) // 2)
    record(description, folder, workers, depth=False, progress=lambda done, total: _told.put((name, done, total)))


def survey(folder: Path, georeference: Georeference, model: str, session: int, name: str) -> list[bytes]:
    """Drive a street with an empty map; the messages that make its map."""
    start = surveyed_start(folder, georeference)
    found, _ = base_map.survey(open_trace(folder), _segmenter(model), start, session, telling(name))
    return found.messages


def rehearse(folder: Path, base_map_file: Path, parking_map: Path, model: str) -> None:
    """Do for some frames what a car will do, so that nothing is left to be compiled when cars drive."""
    trace, stored, spots = open_trace(folder), load_map(base_map_file), ParkingMap.from_geojson(parking_map)
    node = VehicleNode(trace.camera, _segmenter(model), stored_map=stored, spots=spots)
    first = len(trace) // 2  # amid the spots
    for index in range(first, min(first + _REHEARSED_FRAMES, len(trace))):
        node.process(trace[index])
    diff = node.finish()
    if diff is not None:
        encode_diff(diff)


def drive(folder: Path, url: str, outbox: Path, model: str, is_paced: bool, name: str) -> CarReport:
    """One car: fetches the map around its first fix, drives, and hands its diffs in.

    Args:
        is_paced: whether it takes as long as the drive did, where it could be faster.
    """
    trace = open_trace(folder)
    fix = trace[0].gnss
    if fix is None:
        raise AutowazeError(f"{folder}: the car does not know where it is: no GNSS fix")
    with CloudConnection(url) as connection:
        stored, spots = fetch_map_around(connection, fix), fetch_spots(connection)
    georeference = stored.georeference
    assert georeference is not None  # of a map that came from a service
    start = StartingPoint(georeference)
    node = VehicleNode(trace.camera, _segmenter(model), stored_map=stored, start=start, spots=spots)
    follower_connection = CloudConnection(url)
    follower = TileFollower(follower_connection, georeference, stored)
    with (
        closing(Uplink(Outbox(outbox), HttpTransport(CloudConnection(url)))) as uplink,
        closing(LiveDownlink(follower_connection, follower, georeference)) as downlink,
    ):

        def hand_in(message: bytes) -> None:
            """To the end, so that the time until the service has announced what follows is measured."""
            uplink.send(message)
            if not uplink.flush(_PATIENCE_S):
                raise AutowazeError(f"{url} does not take the diffs of {name}: {uplink.trouble or 'it is slow'}")

        found = run_drive(trace, node, hand_in, telling(name, is_paced), downlink=downlink)
        return _report(found, node, uplink.refused)


def _report(found: DriveRecord, node: VehicleNode, refused: int) -> CarReport:
    sizes = [len(message) for message in found.messages]
    metrics = {**latency_metrics(found, node), **network_metrics(found)}
    return CarReport(found.tracked, found.distance_m, sizes, found.end_to_end_ms, refused, metrics)


@cache
def _segmenter(model: str) -> Segmenter:
    return NoSegmentation() if model == NoSegmentation.name else load_segmenter(model)


def announce(name: str) -> None:
    """Tell that something is done."""
    _told.put((name, 1, 1))


def telling(name: str, is_paced: bool = False) -> Callable[[Iterable[StereoFrame], int], Iterator[StereoFrame]]:
    """Frames of a drive, each told of once the car has dealt with it."""

    def frames(trace: Iterable[StereoFrame], total: int) -> Iterator[StereoFrame]:
        begun, first = time.monotonic(), None
        for done, frame in enumerate(trace):
            _told.put((name, done, total))
            first = frame.timestamp if first is None else first
            if is_paced:
                time.sleep(max(0.0, frame.timestamp - first - (time.monotonic() - begun)))
            yield frame
        _told.put((name, total, total))

    return frames
