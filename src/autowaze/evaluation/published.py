"""Drives with everything on: a car at the pace of its cameras, the service, and somebody who follows what it tells."""

from __future__ import annotations

import json
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from autowaze.cloud.service import CloudService
from autowaze.evaluation.drive import DriveRecord, Progress, run_drive
from autowaze.evaluation.live_service import LiveService
from autowaze.traces import Trace
from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.node import StartingPoint, VehicleNode
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.vehicle.uplink import HttpTransport, Uplink
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.frame import StereoFrame
from autowaze.world.parking import ParkingMap
from autowaze.world.stage_times import StageTimes
from autowaze.world.wire import encode_diff

_PATIENCE_S = 60.0
_LAST_NEWS_S = 0.2
_REHEARSED_FRAMES = 12
_SESSION = 1 << 21


@dataclass(frozen=True)
class PublishedDrive:
    """What a drive took.

    Attributes:
        record: of the car; its `end_to_end_ms` end with the receipt that the diff is durable.
        published_ms: per window, from the arrival of its last frame until the listener had heard of the spots that it
            changed; where it changed none, until the receipt.
        closing_ms: per window, from the arrival of its last frame until its diff was there.
        times: of the car's stages.
    """

    record: DriveRecord
    published_ms: list[float]
    closing_ms: list[float]
    times: StageTimes


class Listener:
    """Follows the changes of a service, as who looks for a free spot does.

    Attributes:
        version: of the map when it began.
        heard: by version of the map, when its changes of spots were heard of (seconds of the performance counter).
    """

    def __init__(self, url: str) -> None:
        self.heard: dict[int, float] = {}
        self._socket = connect(f"ws{url.removeprefix('http')}/changes/ws", compression=None, proxy=None)
        self.version = int(json.loads(self._socket.recv(_PATIENCE_S))["version"])
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()
        self._thread.join()

    def _listen(self) -> None:
        with suppress(ConnectionClosed):
            for message in self._socket:
                now = time.perf_counter()
                self.heard[int(json.loads(message)["version"])] = now


def published_passes(
    trace: Trace,
    spots_file: Path,
    segmenter: Segmenter,
    start: StartingPoint,
    passes: int,
    method: str,
    progress: Progress,
) -> tuple[list[PublishedDrive], dict[str, float]]:
    """Drive a trace several times: first with an empty map, then with the map that the passes before left.

    The service runs in a process of its own and keeps diffs in SQLite, the car sends over HTTP from its outbox, and
    the listener follows over a WebSocket; the car has been rehearsed, as the service has.

    Returns:
        The passes, and the median time of each stage of the service in milliseconds.
    """
    spots = ParkingMap.from_geojson(spots_file)
    twin = CloudService(spots, method)
    _rehearse(trace, segmenter, start, spots)
    found = []
    with tempfile.TemporaryDirectory() as folder, LiveService(spots_file, Path(folder), method=method) as service:
        for number in range(passes):
            stored = twin.feature_map if number else None
            node = VehicleNode(
                trace.camera, segmenter, stored_map=stored, start=start, session=_SESSION + number, spots=spots
            )
            found.append(_published(trace, node, service.url, Path(folder) / "outbox", progress))
            for message in found[-1].record.messages:
                twin.receive(message)
        return found, service.stages_ms()


def _published(trace: Trace, node: VehicleNode, url: str, outbox: Path, progress: Progress) -> PublishedDrive:
    begun: list[float] = []
    acknowledged: list[float] = []
    with (
        closing(Listener(url)) as listener,
        closing(Uplink(Outbox(outbox), HttpTransport(CloudConnection(url)))) as uplink,
    ):

        def hand_in(message: bytes) -> None:
            begun.append(time.perf_counter())
            uplink.send(message)
            if not uplink.flush(_PATIENCE_S) or uplink.refused:
                raise AutowazeError(f"{url} does not take the diffs: {uplink.trouble or 'it refuses them'}")
            acknowledged.append(time.perf_counter())

        record = run_drive(trace, node, hand_in, lambda frames, total: _at_pace(progress(frames, total)))
        time.sleep(_LAST_NEWS_S)
    published, closed = [], []
    for number, receipt_ms in enumerate(record.end_to_end_ms):
        heard = listener.heard.get(listener.version + 1 + number, acknowledged[number])
        published.append(receipt_ms + 1000 * max(heard - acknowledged[number], 0.0))
        closed.append(receipt_ms - 1000 * (acknowledged[number] - begun[number]))
    return PublishedDrive(record, published, closed, node.times)


def _at_pace(frames: Iterable[StereoFrame]) -> Iterator[StereoFrame]:
    """The frames as cameras deliver them, or as soon as the car has dealt with the one before."""
    begun, first = time.monotonic(), None
    for frame in frames:
        first = frame.timestamp if first is None else first
        time.sleep(max(0.0, frame.timestamp - first - (time.monotonic() - begun)))
        yield frame


def _rehearse(trace: Trace, segmenter: Segmenter, start: StartingPoint, spots: ParkingMap) -> None:
    """Some frames without and with a map, so that compiled loops are loaded when the clock begins to count."""
    twin = CloudService(spots)
    stored: FeatureMap | None = None
    for session in (_SESSION - 2, _SESSION - 1):
        node = VehicleNode(trace.camera, segmenter, stored_map=stored, start=start, session=session, spots=spots)
        for index in range(min(_REHEARSED_FRAMES, len(trace))):
            node.process(trace[index])
        diff = node.finish()
        if diff is not None:
            twin.receive(encode_diff(diff))
        stored = twin.feature_map
