"""The report's plots."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from autowaze.evaluation.experiments.scores import Calibration, Scores

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {"precision": "#1b6ca8", "recall": "#d98c21", "accuracy": "#3f8f4f"}
_OURS, _OTHER = "#1b6ca8", "#9aa5b1"


def new_figure(width: float, height: float) -> Figure:
    """A figure that needs no screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png_of(figure: Figure) -> bytes:
    """The figure's bytes; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def draw_scores(scores: Mapping[str, Scores], thesis: Mapping[str, tuple[float, float, float]]) -> bytes:
    """Precision, recall and accuracy by method with 95 % intervals; crosses are what the thesis printed."""
    figure = new_figure(9.0, 3.8)
    axes = figure.add_subplot()
    x = np.arange(len(scores))
    for column, (name, colour) in enumerate(COLOURS.items()):
        found = [getattr(s, name) for s in scores.values()]
        at = x + 0.26 * (column - 1)
        value = np.array([f.value for f in found])
        spread = np.maximum([value - [f.low for f in found], [f.high for f in found] - value], 0.0)
        axes.bar(at, value, 0.24, color=colour, label=name)
        axes.errorbar(at, value, spread, fmt="none", ecolor="#202020", capsize=3, linewidth=1)
        printed = [(at[row], thesis[method][column]) for row, method in enumerate(scores) if method in thesis]
        label = "thesis" if column == 0 else None
        if printed:
            axes.scatter(*np.array(printed).T, marker="x", color="#a50026", zorder=3, label=label)
    axes.set_xticks(x, [name.replace(", ", ",\n") for name in scores], fontsize=8)
    axes.set_ylim(0.0, 1.14)
    axes.legend(loc="upper left", fontsize=8, ncols=4)
    return png_of(figure)


def draw_calibration(calibrations: Mapping[str, Calibration]) -> bytes:
    """Share that was vacant by stated probability; the area of a dot says of how many spots."""
    figure = new_figure(5.0, 4.4)
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="#808080", linewidth=1, linestyle="--")
    for (name, found), colour in zip(calibrations.items(), (_OURS, "#d98c21", "#3f8f4f"), strict=False):
        axes.plot(found.stated, found.vacant, color=colour, linewidth=1)
        size = 12 + 220 * found.spots / max(int(found.spots.sum()), 1)
        label = f"{name}: off by {found.error:.3f}, Brier {found.brier:.3f}"
        axes.scatter(found.stated, found.vacant, s=size, color=colour, label=label)
    axes.set(xlabel="stated probability of being vacant", ylabel="share that was vacant", xlim=(-0.04, 1.04))
    axes.set_ylim(-0.04, 1.04)
    axes.legend(fontsize=8, loc="upper left")
    return png_of(figure)


def draw_offsets(offsets_m: Sequence[float], accuracy: Mapping[str, Sequence[float]]) -> bytes:
    """Accuracy by how far the car's position is off."""
    figure = new_figure(5.6, 3.6)
    axes = figure.add_subplot()
    for (name, values), colour in zip(accuracy.items(), (_OTHER, _OURS), strict=False):
        axes.plot(offsets_m, values, marker="o", color=colour, label=name)
    axes.set(xlabel="position off by [m]", ylabel="accuracy", ylim=(0.4, 1.02))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return png_of(figure)


def draw_stages(stages_ms: Mapping[str, tuple[float, float]], bar_ms: float) -> bytes:
    """Median milliseconds by stage, with the 95th percentile; the line is what end to end may take."""
    figure = new_figure(7.5, 0.36 * len(stages_ms) + 1.0)
    axes = figure.add_subplot()
    names = list(stages_ms)[::-1]
    median = np.array([stages_ms[name][0] for name in names])
    p95 = np.array([stages_ms[name][1] for name in names])
    axes.barh(names, median, color=[_OURS if name.startswith("end to end") else _OTHER for name in names])
    axes.errorbar(median, names, xerr=[np.zeros(len(names)), np.maximum(p95 - median, 0)], fmt="none", ecolor="#202020")
    axes.axvline(bar_ms, color="#a50026", linewidth=1, linestyle="--")
    axes.set_xlabel("milliseconds")
    return png_of(figure)
