"""A kerb, or an area beside a street, cut into spots of the usual size."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

SIZES_M = {"parallel": (5.7, 2.0), "perpendicular": (5.0, 2.5), "angled": (5.0, 2.5)}
"""Length and width of a spot (FGSV, EAR: guide to parking facilities)."""
ANGLE_RAD = np.radians(60.0)
"""OpenStreetMap's diagonal parking is `usually at an angle between 45 and 60 degrees`."""
TIGHTEST = 0.85
"""Where more cars were counted than usual spots fit, spots shrink to this part of the usual pitch."""
SLACK = 0.05
"""Part of a spot that a stretch may lack: drawn lengths are no better than that."""
LEAST_COVER = 0.6
"""Share of a cell that an area must cover for it to be a spot."""
_SLACK_M = 3.0


def pitch(kind: str) -> float:
    """Distance from spot to spot along the kerb, metres."""
    length, width = SIZES_M[kind]
    return {"parallel": length, "perpendicular": width}.get(kind, float(width / np.sin(ANGLE_RAD)))


def depth(kind: str) -> float:
    """How far a row of spots reaches from its inner edge, metres."""
    length, width = SIZES_M[kind]
    across = float(length * np.sin(ANGLE_RAD) + width * np.cos(ANGLE_RAD))
    return {"parallel": width, "perpendicular": length}.get(kind, across)


def free_stretches(length_m: float, gaps: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """What of a kerb from 0 to its length no gap (from, to) covers, in order."""
    free, start = [], 0.0
    for low, high in sorted(gaps):
        if low > start:
            free.append((start, min(low, length_m)))
        start = max(start, high)
        if start >= length_m:
            break
    if start < length_m:
        free.append((start, length_m))
    return [(a, b) for a, b in free if b > a]


def spots_per_stretch(stretches: list[tuple[float, float]], kind: str, capacity: int | None) -> tuple[list[int], float]:
    """How many spots each stretch takes, and their pitch.

    Without a capacity as many of the usual pitch as fit. A capacity that is smaller leaves room, the longer stretches
    having more; one that is larger makes spots tighter, to a bound.
    """
    lengths = np.array([b - a for a, b in stretches])
    step = pitch(kind)
    fit = np.floor(lengths / step + SLACK).astype(np.int64)
    if capacity is None:
        return fit.tolist(), step
    while capacity > fit.sum() and step > TIGHTEST * pitch(kind):
        step = max(step * 0.99, TIGHTEST * pitch(kind))
        fit = np.floor(lengths / step + SLACK).astype(np.int64)
    while fit.sum() > capacity:
        fit[int(np.argmin(np.where(fit > 0, lengths / np.maximum(fit, 1), np.inf)))] -= 1
    return fit.tolist(), step


def row_of_spots(
    line: shapely.LineString, stretch: tuple[float, float], count: int, step: float, kind: str, slant: int
) -> list[NDArray[np.float64]]:
    """Outlines, each (4, 2), of spots in the middle of a stretch of the line along their middles, map metres.

    Args:
        slant: 1 if cars in angled spots head to the left of the line and forward, -1 to the right and forward;
            2 and -2 the same, backward.
    """
    start = stretch[0] + (stretch[1] - stretch[0] - count * step) / 2
    at = start + step * (np.arange(count) + 0.5)
    ahead = np.array([_direction(line, s) for s in at]).reshape(-1, 2)
    centre = shapely.get_coordinates(shapely.line_interpolate_point(line, at)).reshape(-1, 2)
    length, width = (step, SIZES_M[kind][1]) if kind == "parallel" else SIZES_M[kind]
    turn = {"parallel": 0.0, "perpendicular": np.pi / 2}.get(kind, ANGLE_RAD if abs(slant) == 1 else np.pi - ANGLE_RAD)
    turn = turn * np.sign(slant)
    along = ahead @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    if kind == "perpendicular":
        width = min(width, step)
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
    corners = centre[:, None] + signs[:, :1] * length * along[:, None] + signs[:, 1:] * width * across[:, None]
    return list(corners)


def area_into_spots(
    area: shapely.Polygon, street: shapely.LineString | None, kind: str | None, capacity: int | None
) -> tuple[list[shapely.Polygon], str]:
    """An area beside a street cut across it into spots, and their kind.

    Without a street nearby the cuts lie across the area's longer side. The kind is guessed from the depth if it is not
    told: cars stand across the street where they fit.
    """
    axis = street if street is not None else _long_axis(area)
    corners = shapely.get_coordinates(area.exterior)
    along = shapely.line_locate_point(axis, shapely.points(corners))
    low, high = float(along.min()), float(along.max())
    if high - low < 1.0:  # it lies beyond the end of the street
        axis = _long_axis(area)
        along = shapely.line_locate_point(axis, shapely.points(corners))
        low, high = float(along.min()), float(along.max())
    length_m = high - low
    deep = area.area / length_m
    kind = kind or ("perpendicular" if deep > SIZES_M["perpendicular"][0] * 0.8 else "parallel")
    count = capacity or max(1, round(length_m / pitch(kind)))
    if not 0.4 * pitch(kind) < length_m / count < 3.0 * pitch(kind):
        count = max(1, round(length_m / pitch(kind)))
    lean = 1.0 / np.tan(ANGLE_RAD) if kind == "angled" else 0.0
    near = shapely.distance(axis, area)
    band = (near - _SLACK_M, near + deep / 2, near + 1.5 * deep + _SLACK_M)
    marks = np.linspace(low, high, count + 1)
    side = _side(axis, area)
    cells = []
    for a, b in pairwise(marks.tolist()):
        piece = shapely.intersection(area, _across(axis, (a, b), band, side, lean))
        parts = [part for part in shapely.get_parts(piece) if isinstance(part, shapely.Polygon)]
        if parts and (largest := max(parts, key=lambda part: part.area)).area >= LEAST_COVER * area.area / count:
            cells.append(largest)
    return cells, kind


def _across(
    axis: shapely.LineString, stretch: tuple[float, float], band: tuple[float, float, float], side: int, lean: float
) -> shapely.Geometry:
    """Ground beside a stretch of an axis, from the first to the last distance of a band.

    Leaning cuts go forward by so much per metre; at the middle of the band they stand where upright ones do.
    """
    low, middle, high = band
    ring = []
    for s, off in ((stretch[0], low), (stretch[1], low), (stretch[1], high), (stretch[0], high)):
        ahead = _direction(axis, s)
        left = np.array([-ahead[1], ahead[0]])
        ring.append(np.array(axis.interpolate(s).coords[0]) + side * off * left + lean * (off - middle) * ahead)
    return shapely.make_valid(shapely.Polygon(ring))


def _direction(line: shapely.LineString, s: float) -> NDArray[np.float64]:
    """Unit direction (2,) of a line at a distance along it."""
    a, b = (np.array(line.interpolate(float(np.clip(x, 0.0, line.length))).coords[0]) for x in (s - 1.0, s + 1.0))
    return np.asarray((b - a) / max(float(np.linalg.norm(b - a)), 1e-9))


def _side(axis: shapely.LineString, area: shapely.Polygon) -> int:
    """1 if the area lies left of the axis, -1 right."""
    within = area.representative_point()  # the centroid of what lies around a bend may not be
    centre = np.array(within.coords[0])
    s = axis.project(within)
    ahead, foot = _direction(axis, s), np.array(axis.interpolate(s).coords[0])
    away = centre - foot
    return 1 if ahead[0] * away[1] - ahead[1] * away[0] >= 0 else -1


def _long_axis(area: shapely.Polygon) -> shapely.LineString:
    """The long side of the smallest rectangle around an area."""
    corners = shapely.get_coordinates(area.minimum_rotated_rectangle)
    row = int(np.argmax(np.hypot(*np.diff(corners[:3], axis=0).T)))
    return shapely.LineString(corners[row : row + 2])
