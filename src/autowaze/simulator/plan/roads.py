"""Roads, and the rows of bays along them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from autowaze.simulator.curve import Curve

LANE_M = 3.1
PAVEMENT_M = 3.4
BAY_SIZES_M = {"parallel": (5.8, 2.15), "perpendicular": (5.1, 2.55), "angled": (5.1, 2.5)}
"""Length and width of a bay; a parallel one is as long as its pitch."""
ANGLED_RAD = np.radians(60.0)


@dataclass(frozen=True)
class Road:
    """One road with two lanes, one each way, driven on the right.

    Attributes:
        centre: the centreline, in map metres.
        parking_m: width of the parking strip to the left and to the right of the carriageway.
        allowed: from where to where along the centre cars may park.
        pavement_m: width of the pavements; 0 for the aisles of a car park.
        driveways: distances along the centre with the side (1 left, -1 right) where cars cross the pavement.
    """

    centre: Curve
    parking_m: tuple[float, float]
    allowed: tuple[float, float]
    pavement_m: float = PAVEMENT_M
    driveways: tuple[tuple[float, int], ...] = ()

    def kerb_m(self, side: int) -> float:
        """Distance from the centre to the outer edge of the parking strip (side 1 left, -1 right)."""
        return LANE_M + self.parking_m[0 if side > 0 else 1]

    def building_line_m(self, side: int) -> float:
        """Distance from the centre to where private ground begins."""
        return self.kerb_m(side) + self.pavement_m

    def strip(self, inner_m: float, outer_m: float, start: float, end: float, side: int) -> Polygon:
        """Ground between two distances from the centre on one side."""
        s = np.linspace(start, end, max(2, int(abs(end - start) / 1.0) + 1))
        inner = self.centre.beside(s, np.full(len(s), side * inner_m))
        outer = self.centre.beside(s, np.full(len(s), side * outer_m))
        return Polygon(np.concatenate([inner, outer[::-1]])).buffer(0)

    @property
    def carriageway(self) -> Polygon:
        """Both lanes."""
        return self.strip(-LANE_M, LANE_M, 0.0, self.centre.length, 1)


@dataclass(frozen=True)
class Bay:
    """One parking spot as painted.

    Attributes:
        corners: (4, 2) map metres; the first edge lies at the lane for bays that cars enter nose first, along the
            kerb's direction of traffic.
        heading_rad: direction in which a car noses in, or drives for a parallel bay; counter-clockwise from east.
        road, s, side: where it lies: distance along that road's centre, 1 left and -1 right.
    """

    id: str
    row: str
    kind: str
    corners: NDArray[np.float64]
    heading_rad: float
    length_m: float
    width_m: float
    road: int
    s: float
    side: int
    polygon: Polygon = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "polygon", Polygon(self.corners))

    @property
    def centre(self) -> NDArray[np.float64]:
        """(2,) map metres."""
        return np.asarray(self.corners.mean(axis=0))


def strip_width(kind: str) -> float:
    """How far a row of this kind reaches from the carriageway."""
    length, width = BAY_SIZES_M[kind]
    if kind == "parallel":
        return width
    if kind == "perpendicular":
        return length
    return float(length * np.sin(ANGLED_RAD) + width * np.cos(ANGLED_RAD))


def pitch(kind: str) -> float:
    """Distance from bay to bay along the kerb."""
    length, width = BAY_SIZES_M[kind]
    return {"parallel": length, "perpendicular": width, "angled": float(width / np.sin(ANGLED_RAD))}[kind]


def make_bay(road: Road, road_index: int, row: str, number: int, kind: str, s: float, side: int, pitch_m: float) -> Bay:
    """The bay whose middle lies at distance `s` along the road."""
    length, width = BAY_SIZES_M[kind]
    if kind == "parallel":
        length = pitch_m
    centre = road.centre.beside(s, side * (LANE_M + strip_width(kind) / 2))
    traffic = float(road.centre.heading(s)) + (np.pi if side > 0 else 0.0)
    turn = {"parallel": 0.0, "perpendicular": -np.pi / 2, "angled": -float(ANGLED_RAD)}[kind]
    heading = traffic + turn
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    signs = np.array([(-1, 1), (-1, -1), (1, -1), (1, 1)], dtype=np.float64) / 2
    corners = centre + signs[:, :1] * length * along + signs[:, 1:] * width * across
    return Bay(f"{row}-{number}", row, kind, corners, heading, length, width, road_index, s, side)
