"""`autowaze demo`: the whole loop on simulated streets, on a live map."""

from __future__ import annotations

import os
import signal
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from autowaze.cli.demo_table import show_outcome
from autowaze.cli.options import JsonFile, console
from autowaze.cli.screenshot import take_screenshot
from autowaze.evaluation.demonstration.crew import Crews
from autowaze.evaluation.demonstration.performance import Performance
from autowaze.evaluation.demonstration.story import tell
from autowaze.evaluation.live_service import LiveService
from autowaze.evaluation.report import report, write_report
from autowaze.vehicle.semantics.model_store import BUNDLED
from autowaze.world.errors import AutowazeError

_AUDIENCE_S = 30.0
"""How long the cars wait for somebody to open the map."""


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for drives, map, service and picture.")] = Path(
        "out/demo"
    ),
    headless: Annotated[
        bool, typer.Option("--headless", help="Open no browser and end by itself, as it does without a terminal.")
    ] = False,
    port: Annotated[int, typer.Option(help="Of the live map; another one where it is taken.", min=0, max=65535)] = 8080,
    seed: Annotated[int, typer.Option(help="Another day: other cars, other spots free.", min=1)] = 1,
    model: Annotated[str, typer.Option(help="Segmentation model of the cars; none goes without.")] = BUNDLED,
    json_file: JsonFile = None,
) -> None:
    """Simulate two streets and three cars, and show on a live map how spots turn free and taken as they drive.

    Examples:

        autowaze demo

        autowaze demo --headless --seed 7 -o /tmp/demo --json /tmp/demo.json
    """
    begun = time.monotonic()
    is_watched = not headless and sys.stdin.isatty() and sys.stdout.isatty() and not os.environ.get("CI")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # whoever ends it, the service and the crews end with it
    story, bars = tell(seed), _Bars()
    with Crews(len(story.surveys), bars.tell) as crews:
        performance = Performance(story, output, crews, model)
        with bars.shown():
            city = performance.prepare()
        with performance.serve(city, port) as service:
            console.print(f"live map: {service.url}")
            if is_watched:
                _invite(service)
            with bars.shown():
                outcome = performance.drive(city, service, is_paced=is_watched)
            show_outcome(outcome)
            picture = output / "live-map.png"
            _take_picture(service, picture)
            console.print(f"{time.monotonic() - begun:.0f} s in all")
            if json_file:
                results = {"all": outcome.metrics(), **{car.name: car.metrics() for car in outcome.cars}}
                write_report(json_file, report({"seed": seed, "model": model}, results))
            if is_watched:
                _stay(service)


class _Bars:
    """A progress bar for each thing that is done, while they are shown."""

    def __init__(self) -> None:
        self._progress: Progress | None = None
        self._tasks: dict[str, TaskID] = {}

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show what begins from now on."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        self._tasks = {}
        with Progress(*columns, console=console) as self._progress:
            yield

    def tell(self, name: str, done: int, total: int) -> None:
        """So many frames of something are done."""
        if self._progress is None:
            return
        if name not in self._tasks:
            self._tasks[name] = self._progress.add_task(name, total=total)
        self._progress.update(self._tasks[name], completed=done)


def _invite(service: LiveService) -> None:
    """Open the map, and wait a while for it to be open."""
    if _has_screen():
        webbrowser.open(service.url)
    console.print("the cars set out as soon as the map is open in a browser")
    deadline = time.monotonic() + _AUDIENCE_S
    while service.listeners() == 0 and time.monotonic() < deadline:
        time.sleep(0.5)


def _has_screen() -> bool:
    return sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _take_picture(service: LiveService, path: Path) -> None:
    try:
        take_screenshot(service.url, path)
        console.print(f"picture of the live map: {path}")
    except AutowazeError as error:
        console.print(f"no picture of the live map: {error}", markup=False)


def _stay(service: LiveService) -> None:
    """Serve until Ctrl-C."""
    console.print(f"{service.url} goes on until Ctrl-C")
    try:
        signal.pause()
    except KeyboardInterrupt:
        console.print("good-bye")
