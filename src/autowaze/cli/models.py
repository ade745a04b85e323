"""`autowaze models`: published segmentation models."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console
from rich.progress import DownloadColumn, Progress, TransferSpeedColumn
from rich.table import Table

from autowaze.cli.options import console
from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.model_store import BUNDLED, ModelStore, bundled_model

app = typer.Typer(help="The bundled segmentation model, and those that others publish.", no_args_is_help=True)


@app.command("list")
def list_models() -> None:
    """Which models there are, under what licence, and which of them lie on this machine.

    Example:

        autowaze models list
    """
    table = Table("name", "what", "licence", "MB", "sha256", "on this machine")
    bundled = bundled_model()
    size, licence = bundled.stat().st_size, ModelConfig.beside(bundled).licence
    table.add_row(BUNDLED, "What every command uses where no model is named", licence, f"{size / 1e6:.0f}", "", "yes")
    for stored in ModelStore().models():
        m = stored.model
        where = str(stored.path) if stored.path else "no"
        table.add_row(m.name, m.summary, m.licence, f"{m.size_bytes / 1e6:.0f}", m.sha256[:12], where)
    console.print(table)


@app.command()
def pull(name: Annotated[str, typer.Argument(help="A name of `autowaze models list`.", show_default=False)]) -> None:
    """Fetch a model, going on where an earlier attempt ended; its checksum is verified.

    Example:

        autowaze models pull mask-rcnn-r50-fpn
    """
    with Progress(
        *Progress.get_default_columns(), DownloadColumn(), TransferSpeedColumn(), console=Console(stderr=True)
    ) as bar:
        task = bar.add_task(name, total=None)
        path = ModelStore().pull(name, lambda done, total: bar.update(task, completed=done, total=total))
    console.print(f"{path}")
