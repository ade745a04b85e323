"""The thesis's car park: 80 m x 30 m, one spot free (thesis, sec. 4.4 and Fig. 4.4).

The thesis gives the outline and the lengths of two ways, no lanes. Here they follow from common dimensions: bays 4.5 m
deep, two-way aisles of 6 m. Bays line the edge all round, so the middle of the aisle before them runs 7.5 m inside it;
two islands of bays fill the rest, with an aisle between them. Cars come in at a quarter of a long side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.evaluation.benefits.lanes import ParkingLanes

LENGTH_M, WIDTH_M = 80.0, 30.0
BAY_DEPTH_M, BAY_WIDTH_M, AISLE_M = 4.5, 2.5, 6.0

_MARGIN_M = BAY_DEPTH_M + AISLE_M / 2
_ENTRANCE_X_M = LENGTH_M / 4


@dataclass(frozen=True)
class ThesisLot:
    """The car park and the one spot that is free in it.

    Attributes:
        lanes: with one entrance.
        vacant: (S,) bool, true for the middle bay on the far side of the aisle between the islands.
    """

    lanes: ParkingLanes
    vacant: NDArray[np.bool_]


def thesis_lot() -> ThesisLot:
    """Lay it out."""
    left, right, low, high = _MARGIN_M, LENGTH_M - _MARGIN_M, _MARGIN_M, WIDTH_M - _MARGIN_M
    middle, entrance = LENGTH_M / 2, _ENTRANCE_X_M
    ring = [(entrance, low), (middle, low), (right, low), (right, high), (middle, high), (left, high), (left, low)]
    lines = [
        shapely.LineString([*ring, ring[0]]),
        shapely.LineString([(middle, low), (middle, high)]),
        shapely.LineString([(entrance, 0.0), (entrance, low)]),
    ]
    bays = [*_along_the_edge(), *_islands()]
    lanes = ParkingLanes(lines, bays, np.array([[entrance, 0.0]]))
    free = shapely.Point(middle + AISLE_M / 2 + BAY_DEPTH_M / 2, WIDTH_M / 2)
    return ThesisLot(lanes, np.array([bay.contains(free) for bay in bays]))


def _along_the_edge() -> list[shapely.Polygon]:
    """Bays on all four sides, save for the corners and where cars come in."""
    gate = shapely.box(_ENTRANCE_X_M - AISLE_M / 2, 0.0, _ENTRANCE_X_M + AISLE_M / 2, BAY_DEPTH_M)
    rows = [
        *_row(_MARGIN_M, 0.0, LENGTH_M - 2 * _MARGIN_M, upright=True),
        *_row(_MARGIN_M, WIDTH_M - BAY_DEPTH_M, LENGTH_M - 2 * _MARGIN_M, upright=True),
        *_row(0.0, _MARGIN_M, WIDTH_M - 2 * _MARGIN_M, upright=False),
        *_row(LENGTH_M - BAY_DEPTH_M, _MARGIN_M, WIDTH_M - 2 * _MARGIN_M, upright=False),
    ]
    return [bay for bay in rows if bay.intersection(gate).area == 0.0]


def _islands() -> list[shapely.Polygon]:
    """Two double rows, and bays at their ends along the aisle between them."""
    low, island_m = _MARGIN_M + AISLE_M / 2, WIDTH_M - 2 * _MARGIN_M - AISLE_M
    outer = _MARGIN_M + AISLE_M / 2
    inner = LENGTH_M / 2 - AISLE_M / 2 - BAY_DEPTH_M
    bays = []
    for mirrored in (False, True):
        ends = _row(inner, low, island_m, upright=False)
        double = [
            *_row(outer, low, inner - outer, upright=True),
            *_row(outer, low + BAY_DEPTH_M, inner - outer, upright=True),
        ]
        for bay in (*ends, *double):
            x0, y0, x1, y1 = bay.bounds
            bays.append(shapely.box(LENGTH_M - x1, y0, LENGTH_M - x0, y1) if mirrored else bay)
    return bays


def _row(x: float, y: float, room_m: float, upright: bool) -> list[shapely.Polygon]:
    """As many bays side by side as there is room for, in the middle of it; upright ones stand along x."""
    count = int(room_m / BAY_WIDTH_M)
    starts = (room_m - count * BAY_WIDTH_M) / 2 + BAY_WIDTH_M * np.arange(count)
    if upright:
        return [shapely.box(x + s, y, x + s + BAY_WIDTH_M, y + BAY_DEPTH_M) for s in starts]
    return [shapely.box(x, y + s, x + BAY_DEPTH_M, y + s + BAY_WIDTH_M) for s in starts]
