"""The worst confusions from above: points, boxes, what was said of the spots, and what was true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from autowaze.evaluation.experiments.figures import new_figure, png_of
from autowaze.evaluation.experiments.judging import DrivenSeries, Verdict, service_after
from autowaze.evaluation.experiments.variants import Variant
from autowaze.world.labels import is_vehicle
from autowaze.world.parking import Occupancy

_COLOURS = {Occupancy.VACANT: "#2ca25f", Occupancy.OCCUPIED: "#de2d26", Occupancy.UNKNOWN: "#969696"}
_AROUND_M = 9.0
_ACROSS = 3


def worst_confusions(verdicts: Sequence[Verdict], most: int = 6) -> list[Verdict]:
    """Wrong answers on counted spots, the surest first."""
    wrong = [v for v in verdicts if v.counts and not v.is_right]
    return sorted(wrong, key=lambda v: -abs(v.probability_vacant - (not v.occupied)))[:most]


def draw_confusions(confusions: Sequence[Verdict], series: Mapping[str, DrivenSeries], variant: Variant) -> bytes:
    """One panel for each, north up.

    Args:
        confusions: at least one.
        series: by name of each of its drives.
        variant: whose mistakes they are.
    """
    rows = -(-len(confusions) // _ACROSS)
    figure = new_figure(4.2 * min(len(confusions), _ACROSS), 4.6 * rows)
    for number, verdict in enumerate(confusions):
        axes = figure.add_subplot(rows, min(len(confusions), _ACROSS), number + 1)
        _draw(axes, verdict, series[verdict.drive], variant)
    return png_of(figure)


def _draw(axes, verdict: Verdict, series: DrivenSeries, variant: Variant) -> None:  # type: ignore[no-untyped-def]
    from matplotlib.patches import Polygon

    cloud = service_after(series, variant, verdict.drive)
    row = series.names.index(verdict.drive)
    passage, truth = series.passages[row], series.truths[row]
    features, path = cloud.map.features, np.array(passage.path)
    vehicle = is_vehicle(features.label)
    states = {state.spot_id: state for state in cloud.states}
    centre = series.spots.by_id[verdict.spot_id].centre
    axes.scatter(*features.position[~vehicle, :2].T, s=3, c="#b0b0b0", linewidths=0)
    axes.scatter(*features.position[vehicle, :2].T, s=6, c="#08519c", linewidths=0)
    for spot in series.spots.spots:
        colour = _COLOURS[states[spot.id].occupancy]
        outline = np.array(spot.polygon.exterior.coords)
        is_asked = spot.id == verdict.spot_id
        axes.add_patch(
            Polygon(outline, facecolor=colour, alpha=0.25, edgecolor=colour, linewidth=3.0 if is_asked else 1.0)
        )
    for outline in truth.corners:
        axes.add_patch(Polygon(outline, fill=False, edgecolor="#000000", linestyle=":", linewidth=1.5))
    for outline in cloud.vehicle_boxes.corners:
        axes.add_patch(Polygon(outline, fill=False, edgecolor="#08519c", linewidth=1.5))
    axes.plot(path[:, 0], path[:, 1], color="#c51b8a", linewidth=1.0)
    axes.set(xlim=centre[0] + np.array([-1, 1]) * _AROUND_M, ylim=centre[1] + np.array([-1, 1]) * _AROUND_M)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=6)
    true = "occupied" if verdict.occupied else "vacant"
    reason = verdict.evidence.split("; ")[0]
    title = f"{verdict.drive}, {verdict.spot_id}: {true}, called {verdict.said} ({verdict.probability_vacant:.2f})"
    axes.set_title(f"{title}\n{reason[:62]}", fontsize=7)
