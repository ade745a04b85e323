"""Real drives through the same apparatus: driven once per model, then judged by every variant."""

from __future__ import annotations

import os
from pathlib import Path

from autowaze.evaluation.datum import Start, map_from_world, starting_point
from autowaze.evaluation.drive import Progress
from autowaze.evaluation.experiments.judging import DrivenSeries
from autowaze.evaluation.experiments.laboratory import Laboratory
from autowaze.evaluation.experiments.passage import Passage, drive_passage
from autowaze.evaluation.experiments.truth import read_labelled_truth
from autowaze.traces import open_trace
from autowaze.traces.recorded import PARKING_MAP
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.errors import AutowazeError
from autowaze.world.parking import ParkingMap

TEST_DATA_VARIABLE = "AUTOWAZE_TEST_DATA"
_SESSION = 1


def recorded_drives() -> tuple[Path, ...]:
    """Folders of real drives with truth, where the environment names a folder of test data."""
    stated = os.environ.get(TEST_DATA_VARIABLE)
    if not stated:
        return ()
    folders = sorted((Path(stated) / "data" / "kitti").glob("*/truth.json"))
    return tuple(path.parent for path in folders if (path.parent / PARKING_MAP).is_file())


def driven_recording(laboratory: Laboratory, folder: Path, segmenter: Segmenter, progress: Progress) -> DrivenSeries:
    """A real drive, with an empty map, told its true pose in the first frame as a survey would, and no other.

    Raises:
        AutowazeError: there is no truth to judge it by.
    """
    trace, spots = open_trace(folder), ParkingMap.from_geojson(folder / PARKING_MAP)
    if trace.ground_truth is None:
        raise AutowazeError(f"{folder}: no ground-truth poses; KITTI drives keep them in poses.txt")
    stored_in = laboratory.folder / "runs" / laboratory.model_name / f"recorded-{folder.name}"
    made_with = laboratory.made_with_model | {"recording": str(folder.resolve())}
    passage = Passage.load(stored_in, made_with)
    if passage is None:
        start = starting_point(trace, spots, Start.FIRST_TRUE_POSE)
        passage = drive_passage(trace, segmenter, spots, start, None, _SESSION, progress)
        passage.save(stored_in, made_with)
    truth = read_labelled_truth(folder, map_from_world(trace.ground_truth, spots))
    return DrivenSeries(folder.name, spots, None, (folder.name,), (passage,), (truth,))
