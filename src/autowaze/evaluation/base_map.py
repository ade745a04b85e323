"""A base map is what a drive finds when the map is empty: building one and updating one are the same operation."""

from __future__ import annotations

from autowaze.cloud.integration import MapState
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import DriveRecord, Progress, run_drive
from autowaze.traces import Trace
from autowaze.vehicle.diffing import DiffSettings
from autowaze.vehicle.node import NodeSettings, VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.feature_map import FeatureMap
from autowaze.world.parking import ParkingMap
from autowaze.world.wire import decode_diff

_BASE_MAP = DiffSettings(max_new_static=2500, max_diff_bytes=500_000)
"""A base map is written to a file, not sent by radio: it may keep more features per window."""

_SESSION = 1
"""Base maps are built apart from any service, the same drive gives the same file."""


def build_base_map(
    trace: Trace,
    segmenter: Segmenter,
    spots: ParkingMap | None = None,
    start: Start = Start.GNSS,
    progress: Progress | None = None,
    settings: NodeSettings | None = None,
) -> tuple[DriveRecord, FeatureMap]:
    """Drive a trace with an empty map and integrate what it found."""
    settings = settings or NodeSettings(diff=_BASE_MAP)
    node = VehicleNode(trace.camera, segmenter, settings, start=starting_point(trace, spots, start), session=_SESSION)
    messages: list[bytes] = []
    record = run_drive(trace, node, messages.append, progress)
    state = MapState(None, node.georeference)
    for message in messages:
        state.integrate(decode_diff(message))
    return record, FeatureMap(state.features, node.georeference, state.version)
