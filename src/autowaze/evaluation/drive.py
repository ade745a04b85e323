"""One car over one trace, with a cloud in the same process or without."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from autowaze.traces import Trace
from autowaze.vehicle.diffing import FrameObservation
from autowaze.vehicle.downlink import Arrivals, Downlink
from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.frame import StereoFrame
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.map_update import MapUpdate
from autowaze.world.parking import ParkingMap
from autowaze.world.wire import encode_diff

Progress = Callable[[Iterable[StereoFrame], int], Iterable[StereoFrame]]
"""Wraps frames, given their number, to show how far a drive has come."""

Watcher = Callable[[StereoFrame, FrameObservation], None]
"""Is shown every frame with what the car made of it."""


@dataclass
class DriveRecord:
    """What a drive left behind.

    Attributes:
        tracked: one per frame.
        diffs: the decoded diffs, and `messages` their bytes as sent.
        end_to_end_ms: per window, from the arrival of its last frame to the published update.
        map_updates: what changed the stored map, by number of the window at the end of which it had come down. With
            these in a `RecordedDownlink` the same drive gives the same diffs again.
        spot_updates: where people park around the car, in the same way.
    """

    tracked: list[TrackedFrame] = field(default_factory=list)
    diffs: list[SemanticMapDiff] = field(default_factory=list)
    messages: list[bytes] = field(default_factory=list)
    end_to_end_ms: list[float] = field(default_factory=list)
    map_updates: dict[int, MapUpdate] = field(default_factory=dict)
    spot_updates: dict[int, ParkingMap] = field(default_factory=dict)

    @property
    def T_map_cam(self) -> NDArray[np.float64]:  # noqa: N802
        """Poses (N, 4, 4)."""
        return np.stack([t.T_map_cam for t in self.tracked])

    @property
    def localized_fraction(self) -> float:
        """Share of the frames that were localised in the stored map."""
        return float(np.mean([t.state is TrackingState.LOCALIZED for t in self.tracked]))

    @property
    def distance_m(self) -> float:
        """Length of the path."""
        return float(np.linalg.norm(np.diff(self.T_map_cam[:, :3, 3], axis=0), axis=1).sum())

    def state_changes(self) -> Iterator[tuple[int, str, str]]:
        """Frame number, state and reason wherever the tracking state changes: lost and found again."""
        before = ""
        for t in self.tracked:
            if t.state != before:
                yield t.index, str(t.state), t.reason
                before = t.state


def run_drive(
    trace: Trace,
    node: VehicleNode,
    receive: Callable[[bytes], object],
    progress: Progress | None = None,
    watch: Watcher | None = None,
    downlink: Downlink | None = None,
    show: Callable[[Arrivals], object] | None = None,
) -> DriveRecord:
    """Drive a trace; every diff goes to `receive` as the bytes that a car sends.

    Between two windows the car takes in what has come down by then, and `show` is shown it.
    """
    record = DriveRecord()
    frames = progress(trace, len(trace)) if progress else trace
    for frame in frames:
        arrived = time.perf_counter()
        diff = node.process(frame)
        if node.observation is not None:
            record.tracked.append(node.observation.tracked)
            if watch is not None:
                watch(frame, node.observation)
        if diff is not None:
            _send(diff, receive, record)
            record.end_to_end_ms.append(1000 * (time.perf_counter() - arrived))
            if downlink is not None:
                _take_in(downlink.arrivals(record.tracked[-1].T_map_cam[:3, 3]), node, record, show)
    diff = node.finish()
    if diff is not None:
        _send(diff, receive, record)
    return record


def _take_in(
    arrivals: Arrivals, node: VehicleNode, record: DriveRecord, show: Callable[[Arrivals], object] | None
) -> None:
    window = len(record.diffs) - 1
    if arrivals.map is not None:
        node.adopt(arrivals.map)
        record.map_updates[window] = arrivals.map
    if arrivals.spots is not None:
        node.look_after(arrivals.spots)
        record.spot_updates[window] = arrivals.spots
    if show is not None:
        show(arrivals)


def _send(diff: SemanticMapDiff, receive: Callable[[bytes], object], record: DriveRecord) -> None:
    message = encode_diff(diff)
    record.diffs.append(diff)
    record.messages.append(message)
    receive(message)
