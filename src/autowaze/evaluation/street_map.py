"""Maps of several drives stitched into one: each drive knows the map that those before it made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.integration import MapState
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import DriveRecord, Progress, run_drive
from autowaze.evaluation.loop_correction import correct_loops
from autowaze.evaluation.map_selection import FEATURES_PER_METRE, worth_keeping
from autowaze.evaluation.survey_registration import register_survey
from autowaze.traces import Trace
from autowaze.vehicle.diffing import DiffSettings
from autowaze.vehicle.node import NodeSettings, VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.identity import ROW_BITS, SEQUENCE_BITS
from autowaze.world.parking import ParkingMap
from autowaze.world.row_registration import scale_sigma_of
from autowaze.world.wire import decode_diff

_SETTINGS = NodeSettings(diff=DiffSettings(max_new_static=3600, max_diff_bytes=500_000))
"""Nearly all that was seen: what is worth keeping is chosen afterwards, with the whole drive in view."""


@dataclass(frozen=True)
class StreetMap:
    """A map and the drives that made it."""

    feature_map: FeatureMap
    drives: list[DriveRecord]

    @property
    def distance_m(self) -> float:
        """Length of all drives."""
        return sum(drive.distance_m for drive in self.drives)


def map_streets(
    traces: Sequence[Trace],
    segmenter: Segmenter,
    spots: ParkingMap | None = None,
    start: Start = Start.GNSS,
    known: FeatureMap | None = None,
    per_metre: float = FEATURES_PER_METRE,
    progress: Progress | None = None,
) -> StreetMap:
    """Drive one trace after another, each with the map so far, and keep of what they found what is worth its bytes.

    A drive that meets a known street is localised in it and adds what it lacks; one that does not begins where its
    start says. What was in the known map is kept or reported gone, never thinned.

    Args:
        traces: of one map frame. start: what each car knows of its first frame.
        known: the map to begin with; None for none.
        per_metre: described features kept for each metre driven.

    Raises:
        AutowazeError: the known map lies in another map frame than the parking map.
    """
    stored, drives = known, []
    if known is not None and spots is not None and known.georeference != spots.georeference:
        raise AutowazeError("the map to extend and the parking map have different map frames: leave one of them out")
    for trace in traces:
        before = stored.features.id if stored else np.zeros(0, np.uint64)
        begin = starting_point(trace, spots, start)
        node = VehicleNode(trace.camera, segmenter, _SETTINGS, stored, begin, session=_unused_session(before))
        drive = run_drive(trace, node, lambda message: None, progress)
        correct_loops(drive, node.slam.loops)
        if stored is None and spots is not None and begin.T_map_cam is not None:
            register_survey(drive, spots, scale_sigma_of(trace.camera))
        state = MapState(stored, node.georeference)
        for message in drive.messages:
            state.integrate(decode_diff(message))
        stored = _thinned(state.as_base_map(), before, drive.T_map_cam, trace, per_metre)
        drives.append(drive)
    return StreetMap(stored or FeatureMap(), drives)


def _thinned(
    found: FeatureMap, known: NDArray[np.uint64], T_map_cam: NDArray[np.float64], trace: Trace, per_metre: float
) -> FeatureMap:
    """The map without what is not worth its bytes of the features that a drive added."""
    keep = np.isin(found.features.id, known)
    added = np.flatnonzero(~keep)
    keep[added] = worth_keeping(found.features[added], T_map_cam, trace.camera, per_metre)
    return FeatureMap(found.features[keep], found.georeference, found.version)


def _unused_session(known: NDArray[np.uint64]) -> int:
    """The least session number that no feature's id carries: the same drives give the same file."""
    used = set(np.unique(known >> np.uint64(SEQUENCE_BITS + ROW_BITS)).tolist())
    return next(n for n in range(1, len(used) + 2) if n not in used)
