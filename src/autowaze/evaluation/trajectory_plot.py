"""Trajectories over the truth, and their errors over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_TRUTH = "#636363"
_COLOURS = ("#c51b8a", "#2b8cbe", "#e6550d", "#31a354", "#756bb1")


@dataclass(frozen=True)
class PlottedErrors:
    """Some errors over time, one panel of the picture.

    Attributes:
        title: with the unit.
        seconds: (N,) float64.
        errors: (N,) float64 each, by name.
    """

    title: str
    seconds: Mapping[str, NDArray[np.float64]]
    errors: Mapping[str, NDArray[np.float64]]


def draw_trajectories(
    path: Path,
    title: str,
    truth: NDArray[np.float64],
    positions: Mapping[str, NDArray[np.float64]],
    panels: list[PlottedErrors],
) -> None:
    """Write the picture; the kind of file follows from its name.

    Args:
        path: picture to write.
        title: printed above.
        truth: (N, 3) true positions in the map, metres.
        positions: estimates (M, 3) in the same frame, by name.
        panels: errors over time, drawn beside the map.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 6), dpi=130, layout="constrained")
    figure.suptitle(title)
    grid = figure.add_gridspec(len(panels), 2, width_ratios=[1.0, 1.2])
    top = figure.add_subplot(grid[:, 0])
    top.plot(truth[:, 0], truth[:, 1], color=_TRUTH, linewidth=4, alpha=0.5, label="truth")
    top.plot(*truth[0, :2], marker="o", color=_TRUTH)
    for colour, (name, xyz) in zip(_COLOURS, positions.items(), strict=False):
        top.plot(xyz[:, 0], xyz[:, 1], color=colour, linewidth=1.5, label=name)
    top.set(xlabel="east [m]", ylabel="north [m]")
    top.set_aspect("equal", adjustable="datalim")
    top.legend(fontsize=9)
    for row, panel in enumerate(panels):
        axes = figure.add_subplot(grid[row, 1])
        for colour, (name, values) in zip(_COLOURS, panel.errors.items(), strict=False):
            axes.plot(panel.seconds[name], values, color=colour, linewidth=1.2, label=name)
        axes.axhline(0.0, color="#bdbdbd", linewidth=0.8)
        axes.set(title=panel.title, xlabel="time [s]" if row == len(panels) - 1 else "")
        axes.legend(fontsize=8)
    FigureCanvasAgg(figure)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
