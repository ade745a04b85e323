"""Renders and drives the series of an experiment, each drive once, and goes on where it was cut short.

    CACHE/
      drives/NAME/          the recorded drive; its images are deleted once it has been driven, unless they are kept
      runs/MODEL/NAME/      what the car sent: see `passage`

The map is carried from drive to drive: each car fetches what the service made of all drives before.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from autowaze.cloud.methods import FUSED
from autowaze.cloud.service import CloudService
from autowaze.evaluation.base_map import integrated
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.demonstration import crew
from autowaze.evaluation.demonstration.crew import Crews, Tell
from autowaze.evaluation.experiments.judging import DrivenSeries
from autowaze.evaluation.experiments.passage import Passage, drive_passage, survey_passage
from autowaze.evaluation.experiments.plan import Experiment, PlannedDrive, Series
from autowaze.evaluation.experiments.truth import read_drive_truth
from autowaze.traces import Trace, open_trace
from autowaze.traces.recorded import INDEX, PARKING_MAP
from autowaze.vehicle.semantics.model_store import BUNDLED, ModelStore, bundled_model
from autowaze.vehicle.semantics.no_segmentation import NoSegmentation
from autowaze.vehicle.semantics.segmenter import Segmenter, load_segmenter
from autowaze.world.feature_map import FeatureMap
from autowaze.world.parking import ParkingMap

_FIRST_SESSION = 1 << 20


@dataclass(frozen=True)
class Laboratory:
    """Where drives are rendered and driven.

    Args:
        folder: the cache.
        model: the cars' segmentation: a name, a path, or none.
        keeps_images: whether images stay on disk after a drive; about 150 MB each.
    """

    folder: Path
    model: str
    keeps_images: bool = False

    def place(self, drive: PlannedDrive) -> Path:
        """Folder of a recorded drive."""
        return self.folder / "drives" / drive.name

    def run_folder(self, drive: PlannedDrive) -> Path:
        """Folder of what the car sent."""
        return self.folder / "runs" / self.model_name / drive.name

    @property
    def model_name(self) -> str:
        """Name of the model with a digest of its weights and settings: others make other runs."""
        return _model_name(self.model)

    def made_with(self, drive: PlannedDrive) -> dict[str, Any]:
        """What a stored run must have been made with to be taken for this drive."""
        return self.made_with_model | {"description": drive.description.model_dump(mode="json")}

    @property
    def made_with_model(self) -> dict[str, Any]:
        """Versions that a run depends on."""
        return {"autowaze": version("autowaze"), "model": self.model_name}

    def passages(self, series: Series) -> list[Passage]:
        """What is stored of a series' drives, up to the first that is missing."""
        found = []
        for drive in series.drives:
            passage = Passage.load(self.run_folder(drive), self.made_with(drive))
            if passage is None:
                break
            found.append(passage)
        return found

    def driven(self, series: Series) -> DrivenSeries | None:
        """What is stored of a series, with the truth of its drives; None without a drive that can be judged."""
        stored = self.passages(series)
        if len(stored) < 2:
            return None
        survey, passages = stored[0], stored[1:]
        judged = series.judged[: len(passages)]
        return DrivenSeries(
            series.street,
            ParkingMap.from_geojson(self.place(series.drives[0]) / PARKING_MAP),
            survey,
            tuple(drive.name for drive in judged),
            tuple(passages),
            tuple(read_drive_truth(self.place(drive)) for drive in judged),
            self._unchanged(series),
        )

    def _unchanged(self, series: Series) -> Passage | None:
        drive = series.unchanged
        return None if drive is None else Passage.load(self.run_folder(drive), self.made_with(drive))


def run_experiments(laboratory: Laboratory, experiments: Sequence[Experiment], jobs: int, tell: Tell) -> None:
    """Render and drive all that is missing, `jobs` series at a time."""
    with Crews(jobs, tell) as crews:
        load = [0.0] * jobs
        futures = []
        for series in sorted((s for one in experiments for s in one.series), key=_work, reverse=True):
            lane = load.index(min(load))
            load[lane] += _work(series)
            futures.append(crews.submit(lane, run_series, laboratory, series))
        for future in futures:
            future.result()


def _work(series: Series) -> float:
    """Pixels that have to be rendered, about."""
    of_drive = (d.description for d in series.to_drive)
    return sum(d.rig.camera.width * d.rig.camera.height * d.length_m * d.ego.fps / d.ego.speed_kmh for d in of_drive)


def run_series(laboratory: Laboratory, series: Series) -> None:
    """Render and drive what is missing of one series."""
    base_map: FeatureMap | None = None
    cloud: CloudService | None = None
    spots = None
    for drive in series.to_drive:
        passage = Passage.load(laboratory.run_folder(drive), laboratory.made_with(drive))
        if passage is None:
            stored = cloud.feature_map if cloud is not None else None
            passage = _drive(laboratory, drive, stored)
        crew.announce(drive.name)
        spots = spots or ParkingMap.from_geojson(laboratory.place(drive) / PARKING_MAP)
        if cloud is None:
            base_map = integrated(passage.messages, spots.georeference)
            cloud = CloudService(spots, FUSED, base_map)
        elif drive is not series.unchanged:
            for message in passage.messages:
                cloud.receive(message)


def _drive(laboratory: Laboratory, drive: PlannedDrive, stored: FeatureMap | None) -> Passage:
    place = laboratory.place(drive)
    if not (place / INDEX).is_file():
        crew.render(drive.description, place, f"{drive.name}, rendering")
    trace, spots = open_trace(place), ParkingMap.from_geojson(place / PARKING_MAP)
    segmenter, session = _segmenter(laboratory.model), _FIRST_SESSION + drive.number
    progress = crew.telling(f"{drive.name}, driving")
    if drive.number == 0:
        start = starting_point(trace, spots, Start.FIRST_TRUE_POSE)
        passage = survey_passage(trace, segmenter, start, session, progress, spots)
    else:
        start = starting_point(trace, spots, Start.GNSS)
        passage = drive_passage(trace, segmenter, spots, start, stored, session, progress)
    passage.save(laboratory.run_folder(drive), laboratory.made_with(drive))
    if not laboratory.keeps_images:
        for images in (place / "left", place / "right", place / "ground_truth" / "ids"):
            shutil.rmtree(images, ignore_errors=True)
    return passage


def street_of(laboratory: Laboratory, series: Series) -> tuple[ParkingMap, FeatureMap]:
    """Spots and base map of a series that has been driven."""
    spots = ParkingMap.from_geojson(laboratory.place(series.drives[0]) / PARKING_MAP)
    return spots, integrated(laboratory.passages(series)[0].messages, spots.georeference)


def recorded_again(laboratory: Laboratory, series: Series, drives: int, tell: Tell) -> list[Trace]:
    """Judged drives of a series with their images, rendered anew where those have been deleted."""
    traces = []
    with Crews(1, tell) as crews:
        for drive in series.judged[:drives]:
            place = laboratory.place(drive)
            if not (place / "left").is_dir():
                place = laboratory.folder / "again" / drive.name
                crews.submit(0, crew.render, drive.description, place, f"{drive.name}, rendering").result()
            traces.append(open_trace(place))
    return traces


@cache
def _segmenter(model: str) -> Segmenter:
    return NoSegmentation() if model == NoSegmentation.name else load_segmenter(model)


@cache
def _model_name(model: str) -> str:
    if model == NoSegmentation.name:
        return model
    file = bundled_model() if model == BUNDLED else Path(model)
    file = file if file.is_file() else ModelStore().path(model)
    parts = [path.read_bytes() for path in (file, file.with_suffix(".json")) if path.is_file()]
    return f"{Path(model).stem}-{hashlib.sha256(b''.join(parts)).hexdigest()[:8]}"
