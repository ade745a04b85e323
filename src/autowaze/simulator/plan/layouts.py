"""The courses of the roads and the ego vehicle's route, for each kind of layout."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from autowaze.simulator.curve import Curve, bend, rounded
from autowaze.simulator.description import StreetDescription
from autowaze.simulator.plan.roads import LANE_M, Road, strip_width

_APPROACH_M = 48.0
"""How far roads run on beyond the last crossing."""
_CLEAR_OF_CROSSING_M = 12.5
_LANE_CENTRE_M = LANE_M / 2
_AISLE_OFFSET_M = 0.7
"""How far right of the middle of an aisle people drive."""

Course = tuple[list[Road], Curve, list[int]]
"""Roads, the route of the middle of the ego vehicle, and the roads along which cars may park."""


def math_heading(description: StreetDescription) -> float:
    """Direction of the street, radians counter-clockwise from east."""
    return float(np.pi / 2 - np.radians(description.heading_deg))


def _road(centre: Curve, allowed: tuple[float, float], pavement: bool = True) -> Road:
    road = Road(centre, (0.0, 0.0), allowed)
    return road if pavement else replace(road, pavement_m=0.0)


def through_street(description: StreetDescription) -> Course:
    """One street between two crossings, from where a cross street comes in at either end."""
    length = description.length_m
    total = length + 2 * _APPROACH_M
    heading = math_heading(description)
    turn = np.radians(description.turn_deg) * total / length if description.layout == "curved" else 0.0
    main = bend([0.0, 0.0], heading - turn * _APPROACH_M / total, total, turn)
    main = Curve(main.points - main.at(_APPROACH_M))
    roads = [_road(main, (_APPROACH_M + _CLEAR_OF_CROSSING_M, _APPROACH_M + length - _CLEAR_OF_CROSSING_M))]
    for s in (_APPROACH_M, _APPROACH_M + length):
        middle, left = main.at(s), main.left(s)
        cross = Curve(np.stack([middle - _APPROACH_M * left, middle + _APPROACH_M * left]))
        roads.append(_road(cross, (0.0, 0.0)))
    lane = main.offset(-_LANE_CENTRE_M)
    route = lane.part(_APPROACH_M - 6.0, _APPROACH_M + length + 4.0)
    return roads, route, [0]


def block(description: StreetDescription) -> Course:
    """Four streets round a block, driven clockwise, so that all turns are to the right."""
    heading = math_heading(description)
    along = np.array([np.cos(heading), np.sin(heading)])
    right = np.array([along[1], -along[0]])
    corners = [
        np.zeros(2),
        description.length_m * along,
        description.length_m * along + description.depth_m * right,
        description.depth_m * right,
    ]
    roads = []
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        direction = (b - a) / np.linalg.norm(b - a)
        side_length = float(np.linalg.norm(b - a))
        centre = Curve(np.stack([a - _APPROACH_M * direction, b + _APPROACH_M * direction]))
        roads.append(
            _road(centre, (_APPROACH_M + _CLEAR_OF_CROSSING_M, _APPROACH_M + side_length - _CLEAR_OF_CROSSING_M))
        )
    middle = np.mean(corners, axis=0)
    inset = [
        c + _LANE_CENTRE_M * (np.sign((middle - c) @ along) * along + np.sign((middle - c) @ right) * right)
        for c in corners
    ]
    start = inset[0] + 16.0 * along
    route = rounded([start, inset[1], inset[2], inset[3], inset[0], start + 26.0 * along], 6.5)
    return roads, route, [0, 1, 2, 3]


def car_park(description: StreetDescription) -> Course:
    """Two aisles with bays on both sides, joined at their ends."""
    heading = math_heading(description)
    along = np.array([np.cos(heading), np.sin(heading)])
    right = np.array([along[1], -along[0]])
    between = 2 * (LANE_M + strip_width("perpendicular")) + 0.6
    length = description.length_m
    aisles = []
    for i, (a, b) in enumerate([(0.0, length), (length, 0.0)]):
        centre = Curve(np.stack([a * along, b * along]) + i * between * right)
        aisles.append(_road(centre, (7.0, length - 7.0), pavement=False))
    # between two rows of tails people keep nearer the middle than on a road
    turn_lane = _AISLE_OFFSET_M
    corners = [
        3.0 * along + turn_lane * right,
        (length - LANE_M) * along + turn_lane * right,
        (length - LANE_M) * along + (between - turn_lane) * right,
        1.0 * along + (between - turn_lane) * right,
    ]
    return aisles, rounded(corners, 5.5), [0, 1]
