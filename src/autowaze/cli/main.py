"""`autowaze`: the command line."""

from __future__ import annotations

import sys

import typer
from rich.console import Console
from rich.markup import escape

from autowaze import __version__
from autowaze.cli import cloud, evaluate, models, spots
from autowaze.cli.demo import demo
from autowaze.cli.drive import drive
from autowaze.cli.map import build_map
from autowaze.cli.simulate import simulate
from autowaze.world.errors import AutowazeError

app = typer.Typer(
    name="autowaze",
    help="Every car with a stereo camera becomes a parking sensor.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command("demo")(demo)
app.command("simulate")(simulate)
app.command("map")(build_map)
app.command("drive")(drive)
app.add_typer(cloud.app, name="cloud")
app.add_typer(evaluate.app, name="evaluate")
app.add_typer(models.app, name="models")
app.add_typer(spots.app, name="spots")


@app.callback(invoke_without_command=True)
def root(version: bool = typer.Option(False, "--version", help="Print the version and exit.")) -> None:
    """Say the version, if asked."""
    if version:
        typer.echo(f"autowaze {__version__}")
        raise typer.Exit


def run() -> None:
    """Entry point: an `AutowazeError` becomes one line and exit code 2."""
    try:
        app()
    except AutowazeError as error:
        Console(stderr=True, highlight=False, soft_wrap=True).print("[bold red]error:[/]", escape(str(error)))
        sys.exit(2)
