"""`autowaze simulate`: render a stereo drive with ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def simulate(
    street: Annotated[
        str,
        typer.Argument(
            help="A preset (town-a, town-b, gold, langslow, stewart, lot-b, loop, suburb, high-street) or a .toml file."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the trace; a recording cut short goes on.")],
    seed: Annotated[int | None, typer.Option(help="Another street of the same description.")] = None,
    drive: Annotated[int | None, typer.Option(help="Another drive: other cars, occupancy, traffic, noise.")] = None,
    frames: Annotated[int | None, typer.Option(help="Stop after so many frames.")] = None,
    occupancy: Annotated[float | None, typer.Option(help="Share of the spots that are taken, 0 to 1.")] = None,
    parked_as: Annotated[
        int | None, typer.Option(help="Whose cars are parked: another drive's, by its number.")
    ] = None,
    changed: Annotated[
        float | None, typer.Option(help="With --parked-as: share of the spots that changed since.")
    ] = None,
    weather: Annotated[str | None, typer.Option(help="clear, hazy, overcast or dusk.")] = None,
    time: Annotated[float | None, typer.Option(help="Hour of the day by the sun.")] = None,
    rig: Annotated[str | None, typer.Option(help="kitti, zed2i-720 or zed2i-540.")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; one per processor unless given.")] = None,
    depth: Annotated[bool, typer.Option(help="Write depth images into the ground truth.")] = True,
) -> None:
    """Make a stereo drive with ground truth through a simulated street.

    autowaze simulate town-a -o /tmp/town --drive 3

    autowaze simulate town-a -o /tmp/later --drive 4 --parked-as 3 --changed 0.6

    autowaze simulate street.toml -o /tmp/street --weather dusk --frames 50
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from autowaze.simulator import load_description, record

    changes: dict[str, dict[str, object]] = {
        "ego": {"frames": frames},
        "parking": {"occupancy": occupancy, "drive": parked_as, "changed": changed},
        "light": {"weather": weather, "solar_time": time},
        "rig": {"name": rig},
    }
    given = {part: {k: v for k, v in values.items() if v is not None} for part, values in changes.items()}
    description = load_description(
        street, seed=seed, drive=drive, **{part: values for part, values in given.items() if values}
    )
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns) as bar:
        task = bar.add_task(f"simulating {description.name}", total=None)
        count = record(
            description, output, workers, depth, lambda done, total: bar.update(task, completed=done, total=total)
        )
    typer.echo(f"{output}: {count} frames")
