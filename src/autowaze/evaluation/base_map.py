"""A base map is what a drive finds when the map is empty: building one and updating one are the same operation."""

from __future__ import annotations

from collections.abc import Iterable

from autowaze.cloud.integration import MapState
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import DriveRecord, Progress, run_drive
from autowaze.evaluation.loop_correction import correct_loops
from autowaze.evaluation.survey_registration import register_survey
from autowaze.traces import Trace
from autowaze.vehicle.diffing import DiffSettings
from autowaze.vehicle.node import NodeSettings, StartingPoint, VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap
from autowaze.world.row_registration import scale_sigma_of
from autowaze.world.wire import decode_diff

SURVEY = DiffSettings(max_new_static=2500, max_diff_bytes=500_000)
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
    begin = starting_point(trace, spots, start)
    record, georeference = survey(trace, segmenter, begin, _SESSION, progress, settings, spots)
    return record, integrated(record.messages, georeference)


def survey(
    trace: Trace,
    segmenter: Segmenter,
    start: StartingPoint,
    session: int,
    progress: Progress | None = None,
    settings: NodeSettings | None = None,
    spots: ParkingMap | None = None,
) -> tuple[DriveRecord, Georeference | None]:
    """Drive a trace with an empty map; what it found is in the messages, in the map frame returned with them.

    Where the drive came back to where it had been, they are as known after the drive, not as told on the way. Where its
    first pose was surveyed, and `spots` say where people park, they are laid onto the parking map.
    """
    settings = settings or NodeSettings(diff=SURVEY)
    node = VehicleNode(trace.camera, segmenter, settings, start=start, session=session)
    record = run_drive(trace, node, lambda message: None, progress)
    correct_survey(record, node, trace.camera, start, spots)
    return record, node.georeference


def correct_survey(
    record: DriveRecord, node: VehicleNode, camera: StereoCamera, start: StartingPoint, spots: ParkingMap | None
) -> None:
    """Move the diffs of a finished drive to where it is known to have been, by its loops and by parked vehicles."""
    correct_loops(record, node.slam.loops)
    if spots is not None and start.T_map_cam is not None:
        register_survey(record, spots, scale_sigma_of(camera))


def integrated(messages: Iterable[bytes], georeference: Georeference | None) -> FeatureMap:
    """The map that the diffs of one survey make, or of several in one map frame."""
    state = MapState(None, georeference)
    for message in messages:
        state.integrate(decode_diff(message))
    return state.as_base_map()
