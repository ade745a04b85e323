"""The main job on embedded defaults: a survey drive builds the map, a later car says which spots are free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from autowaze.cloud.service import CloudService
from autowaze.evaluation.accuracy import Confusion, confusion, read_truth
from autowaze.evaluation.base_map import build_base_map
from autowaze.evaluation.birdseye import draw_birdseye
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import DriveRecord, Progress, run_drive
from autowaze.simulator import load_description, record
from autowaze.traces import Trace, open_trace
from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.map_file import save_map
from autowaze.world.parking import ParkingMap

_SURVEY_DRIVE, _FLEET_DRIVE = 0, 1


@dataclass(frozen=True)
class Demonstration:
    """What came out, and where to look at it."""

    trace: Trace
    record: DriveRecord
    node: VehicleNode
    cloud: CloudService
    scores: Confusion
    picture: Path


def demonstrate(
    street: str,
    folder: Path,
    segmenter: Segmenter,
    rendering: Callable[[str], Callable[[int, int], None]],
    driving: Progress,
) -> Demonstration:
    """Simulate two drives through a street, map it with the first, find its vacant spots with the second.

    The survey car knows where it starts, as surveyors do. The second car comes another day, when other cars are
    parked; it knows its GNSS fixes and the map. Truth is only opened to score it.

    Args:
        street: name of a preset or a .toml file.
        folder: where drives, map and picture go; drives that are there already are not rendered again.
        segmenter: the cars' segmentation.
        rendering: given a title, returns what is told of frames done and in all.
        driving: shows the progress of a drive.
    """
    traces = []
    for number, title in ((_SURVEY_DRIVE, "survey drive"), (_FLEET_DRIVE, "second drive")):
        target = folder / f"{Path(street).stem}-{number}"
        record(load_description(street, drive=number), target, depth=False, progress=rendering(title))
        traces.append(open_trace(target))
    survey, trace = traces
    truth_folder = folder / f"{Path(street).stem}-{_FLEET_DRIVE}"
    spots = ParkingMap.from_geojson(truth_folder / "parking_map.geojson")
    _, base_map = build_base_map(survey, segmenter, spots, Start.FIRST_TRUE_POSE, driving)
    save_map(base_map, folder / "street.map")
    cloud = CloudService(spots, base_map=base_map)
    start = starting_point(trace, spots, Start.GNSS)
    node = VehicleNode(trace.camera, segmenter, stored_map=base_map, start=start, session=2)
    drive = run_drive(trace, node, cloud.receive, driving)
    picture = folder / "demo.png"
    draw_birdseye(picture, drive.T_map_cam, cloud, title=f"{trace.name}: what the cloud believes")
    scores = confusion(cloud.states, read_truth(truth_folder / "ground_truth" / "truth.json"))
    return Demonstration(trace, drive, node, cloud, scores, picture)
