"""The bird's-eye view of a drive: path, map points, vehicles, spots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.service import CloudService
from autowaze.world.labels import is_vehicle
from autowaze.world.parking import Occupancy

_SPOT_COLOURS = {Occupancy.VACANT: "#2ca25f", Occupancy.OCCUPIED: "#de2d26", Occupancy.UNKNOWN: "#969696"}
_MARGIN_M = 6.0


def draw_birdseye(path: Path, T_map_cam: NDArray[np.float64], cloud: CloudService, title: str = "") -> None:
    """Write a picture of what the cloud believes after a drive; the kind of file follows from its name.

    Args:
        path: picture to write.
        T_map_cam: the drive's poses (N, 4, 4).
        cloud: the service that took the drive's diffs.
        title: printed above.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch, Polygon

    features = cloud.feature_map.features
    vehicle = is_vehicle(features.label)
    track = T_map_cam[:, :2, 3]
    low, high = _extent(track, cloud)
    aspect = (high - low)[1] / (high - low)[0]
    figure = Figure(figsize=(12, float(np.clip(12 * aspect, 5, 14))), dpi=130, layout="constrained")
    axes = figure.add_subplot()
    static = features.position[~vehicle]
    axes.scatter(static[:, 0], static[:, 1], s=1.5, c="#b0b0b0", linewidths=0, label="map features")
    for spot, state in zip(cloud.spots.polygons, cloud.states, strict=True):
        colour, outline = _SPOT_COLOURS[state.occupancy], np.array(spot.exterior.coords)
        axes.add_patch(Polygon(outline, facecolor=colour, alpha=0.3, edgecolor=colour, linewidth=1.5))
        axes.annotate(
            f"{state.spot_id}\n{state.probability_vacant:.2f}",
            outline[:-1].mean(axis=0),
            fontsize=7,
            ha="center",
            va="center",
        )
    group = (features.instance_key[vehicle] % np.uint64(10)).astype(int)
    points = features.position[vehicle]
    axes.scatter(points[:, 0], points[:, 1], s=4, c=group, cmap="tab10", linewidths=0, label="vehicle features")
    for box in cloud.vehicle_boxes.polygons:
        axes.add_patch(Polygon(np.array(box.exterior.coords), fill=False, edgecolor="#08519c", linewidth=1.5))
    (line,) = axes.plot(track[:, 0], track[:, 1], color="#c51b8a", linewidth=1.5, label="path")
    axes.plot(*track[0], marker="o", color="#c51b8a", markersize=5)
    spots = [Patch(facecolor=colour, alpha=0.5, label=str(state)) for state, colour in _SPOT_COLOURS.items()]
    box_key = Patch(fill=False, edgecolor="#08519c", label="vehicle box")
    axes.legend(handles=[*spots, box_key, line], loc="upper left", fontsize=8)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="east [m]", ylabel="north [m]", title=title)
    axes.set_aspect("equal")
    FigureCanvasAgg(figure)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def _extent(track: NDArray[np.float64], cloud: CloudService) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower left and upper right corner (2,) around path and nearby spots, metres."""
    centres = cloud.spots.centre
    near = np.linalg.norm(centres[:, None] - track[None, ::5], axis=2).min(axis=1) < 60.0
    points = np.concatenate([track, centres[near]])
    return points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
