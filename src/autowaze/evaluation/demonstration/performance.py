"""The whole demonstration in one page: simulate, survey, serve, drive, compare with the truth."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from autowaze.evaluation.accuracy import confusion
from autowaze.evaluation.base_map import integrated
from autowaze.evaluation.demonstration import crew
from autowaze.evaluation.demonstration.city import City, found_city
from autowaze.evaluation.demonstration.crew import CarReport, Crews
from autowaze.evaluation.demonstration.outcome import CarOutcome, Outcome, compare_changes
from autowaze.evaluation.demonstration.story import Drive, Story
from autowaze.evaluation.live_service import LiveService
from autowaze.evaluation.localization import localization_errors
from autowaze.world.map_file import save_map
from autowaze.world.parking import SpotState

BASE_MAP = "base.map"


class Performance:
    """Plays a story.

    Args:
        folder: for drives, map, service and pictures; drives that are there already are not rendered again.
        crews: who renders, surveys and drives.
        model: the cars' segmentation: a name, a path, or none.
    """

    def __init__(self, story: Story, folder: Path, crews: Crews, model: str) -> None:
        self._story, self._folder, self._crews, self._model = story, folder, crews, model
        self._runs = folder / "service"

    def prepare(self) -> City:
        """Simulate all drives; make city and base map of what the surveys found."""
        shutil.rmtree(self._runs, ignore_errors=True)
        self._runs.mkdir(parents=True)
        story, crews, origin = self._story, self._crews, self._story.georeference
        rendered = {
            drive.name: crews.submit(drive.street, crew.render, drive.description, self._place(drive), drive.name)
            for drive in story.drives
        }
        found = []
        for number, drive in enumerate(story.surveys, start=1):
            rendered[drive.name].result()
            # by the crew of the next street: that of the first has most to render
            job = (self._place(drive), origin, self._model, number, f"{drive.name}, map")
            found.append(crews.submit(drive.street + 1, crew.survey, *job))
        for future in rendered.values():
            future.result()
        messages = [future.result() for future in found]
        base_map = self._runs / BASE_MAP
        save_map(integrated(chain.from_iterable(messages), origin), base_map)
        city = found_city([self._place(drive) for drive in story.surveys], origin, self._runs)
        rehearsals = [
            crews.submit(drive.street, crew.rehearse, self._place(drive), base_map, city.parking_map, self._model)
            for drive in story.surveys
        ]
        for rehearsal in rehearsals:
            rehearsal.result()
        return city

    def serve(self, city: City, port: int) -> LiveService:
        """Start the service."""
        return LiveService(city.parking_map, self._runs, port, self._runs / BASE_MAP, city.streets)

    def drive(self, city: City, service: LiveService, is_paced: bool = False) -> Outcome:
        """Let the cars drive; only then look at the truth."""
        story = self._story
        reports = self._send_out(story.first, service, is_paced)
        told_first = service.spots()
        reports += self._send_out((story.later,), service, is_paced)
        told_later = service.spots()
        told = [*(told_first for _ in story.first), told_later]
        cars = tuple(map(self._compare, story.cars, reports, told, (city for _ in reports)))
        streets = [d for d in story.first if d.street == story.later.street]
        true_then, true_now = (city.truth(self._place(d), d.street) for d in (*streets, story.later))
        changes, noticed = compare_changes((told_first, told_later), (true_then, true_now))
        return Outcome(cars, changes, noticed, service.stages_ms(), told_later)

    def _send_out(self, drives: Sequence[Drive], service: LiveService, is_paced: bool) -> list[CarReport]:
        """Cars that drive at the same time."""
        out = []
        for drive in drives:
            outbox = self._runs / f"outbox of {drive.name}"
            job = (self._place(drive), service.url, outbox, self._model, is_paced, drive.name)
            out.append(self._crews.submit(drive.street, crew.drive, *job))
        return [future.result() for future in out]

    def _compare(self, drive: Drive, report: CarReport, told: Sequence[SpotState], city: City) -> CarOutcome:
        place = self._place(drive)
        return CarOutcome(
            drive.name,
            city.names[drive.street],
            confusion(told, city.truth(place, drive.street)),
            localization_errors(report.tracked, city.true_poses(place)),
            report,
        )

    def _place(self, drive: Drive) -> Path:
        return self._folder / "drives" / drive.name.replace(" ", "-")
