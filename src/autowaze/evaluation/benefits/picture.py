"""The benefits drawn: both ways through the thesis's car park, and search lengths by occupancy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from autowaze.evaluation.benefits.places import PlaceKind
from autowaze.evaluation.benefits.study import SearchLengths
from autowaze.evaluation.benefits.thesis_lot import ThesisLot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WITHOUT, _WITH = "#d7301f", "#238b45"  # the thesis's red and green path
_ASIDE_M = 0.35  # so that one way does not hide the other


def draw_benefits(path: Path, lot: ThesisLot, lengths: Mapping[tuple[PlaceKind, float], SearchLengths]) -> None:
    """Write the picture; the kind of file follows from its name."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    kinds = list(dict.fromkeys(kind for kind, _ in lengths))
    figure = Figure(figsize=(12, 9), dpi=130, layout="constrained")
    grid = figure.add_gridspec(2, max(len(kinds), 1), height_ratios=[1.2, 1.0])
    _draw_lot(figure.add_subplot(grid[0, :]), lot)
    for column, kind in enumerate(kinds):
        axes = figure.add_subplot(grid[1, column])
        _draw_lengths(axes, {occupancy: found for (k, occupancy), found in lengths.items() if k is kind})
        axes.set(title=str(kind), ylabel="search [m]" if column == 0 else "")
    FigureCanvasAgg(figure)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def _draw_lot(axes: Axes, lot: ThesisLot) -> None:
    from matplotlib.patches import Polygon

    for spot, is_vacant in zip(lot.lanes.spots, lot.vacant, strict=True):
        colour = _WITH if is_vacant else "#bdbdbd"
        axes.add_patch(Polygon(np.array(spot.exterior.coords), facecolor=colour, edgecolor="white", linewidth=0.8))
    target = int(np.flatnonzero(lot.vacant)[0])
    without_m, search = lot.lanes.longest_search(0, lot.vacant)
    way, way_m = lot.lanes.way_to(0, target), lot.lanes.to_spots_m(0)[target]
    for points, aside_m, colour, label in (
        (search, _ASIDE_M, _WITHOUT, f"without Autowaze, {without_m:.0f} m"),
        (way, -_ASIDE_M, _WITH, f"with Autowaze, {way_m:.0f} m"),
    ):
        axes.plot(*(points + aside_m).T, color=colour, linewidth=2.5, label=label)
    axes.legend(loc="upper right", fontsize=9)
    axes.set(xlabel="[m]", ylabel="[m]", title="the thesis's car park, one spot free: the unluckiest search")
    axes.set_aspect("equal")
    axes.autoscale_view()


def _draw_lengths(axes: Axes, by_occupancy: Mapping[float, SearchLengths]) -> None:
    """Medians with the 5th to 95th percentile."""
    x = np.arange(len(by_occupancy))
    for shift, colour, name in ((-0.18, _WITHOUT, "without"), (0.18, _WITH, "with")):
        columns = [found.without_m if name == "without" else found.with_m for found in by_occupancy.values()]
        low, median, high = np.array([np.percentile(metres, [5, 50, 95]) for metres in columns]).T
        axes.bar(x + shift, median, 0.34, color=colour, alpha=0.75, label=name)
        axes.errorbar(x + shift, median, [median - low, high - median], fmt="none", ecolor="#404040", capsize=3)
    axes.set_xticks(x, ["one free" if occupancy == 1.0 else f"{occupancy:.0%}" for occupancy in by_occupancy])
    axes.set_xlabel("spots taken")
    axes.legend(fontsize=8)
