"""Where along the streets of OpenStreetMap cars may park: kerbs without junctions, driveways, crossings, bus stops."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingSpot
from autowaze.world.surveys.kerb_rules import SIDES, KerbRule, Position, kerb_rule
from autowaze.world.surveys.kerb_spots import depth, free_stretches, row_of_spots, spots_per_stretch
from autowaze.world.surveys.osm_extract import OsmExtract, OsmNode, OsmWay
from autowaze.world.surveys.osm_streets import is_street, width_m

JUNCTION_CLEAR_M = 5.0
"""From where the kerbs meet (German StVO, sec. 12 (3) 1.; elsewhere 6 m or more)."""
CROSSING_CLEAR_M = 5.0
"""Before and behind the middle of a crossing (StVO, sec. 26 and signs 293)."""
BUS_STOP_CLEAR_M = 15.0
"""Before and behind the sign (StVO, sign 224)."""
DRIVEWAY_CLEAR_M = 1.0
BUS_STOP_REACH_M = 15.0
_STRAIGHT_RAD = np.radians(45.0)
"""Where two ways meet at a smaller bend, one street goes on."""
_SHORTEST_KERB_M = 3.0
_SMOOTH_M = 0.1
"""Kinks smaller than this come from how precisely nodes are stored."""

_Gap = tuple[float, float]


@dataclass(frozen=True)
class _Street:
    way: OsmWay
    line: shapely.LineString
    points: NDArray[np.float64]
    width_m: float


class KerbSurvey:
    """Goes along every kerb of an extract.

    Attributes:
        left_out: kerbs that have no spots, by reason.
    """

    def __init__(self, extract: OsmExtract, georeference: Georeference) -> None:
        self._streets: dict[int, _Street] = {}
        self._at_node: dict[int, list[tuple[int, int]]] = defaultdict(list)
        self.left_out: Counter[str] = Counter()
        for way in extract.ways:
            if not is_street(way.tags):
                continue
            points = georeference.to_map(way.lon_lat)[:, :2]
            line = shapely.LineString(points)
            if line.length < _SHORTEST_KERB_M or not line.is_valid:
                continue
            self._streets[way.id] = _Street(way, line, points, width_m(way.tags))
            for number, node in enumerate(way.nodes):
                self._at_node[node].append((way.id, number))
        self._crossings = {node.id for node in extract.nodes if node.tags.get("highway") == "crossing"}
        self._stops = _bus_stops(extract.nodes, georeference)
        self._stop_tree = shapely.STRtree([shapely.Point(stop) for stop in self._stops])

    def spots(self) -> list[ParkingSpot]:
        """All spots along kerbs, in the order of the ways, left before right."""
        found = []
        for street in self._streets.values():
            for side in SIDES:
                rule = kerb_rule(street.way.tags, side)
                if isinstance(rule, str):
                    self.left_out[f"kerbs: {rule}"] += 1
                elif rule is not None:
                    found += self._along(street, side, rule)
        return found

    def _along(self, street: _Street, side: str, rule: KerbRule) -> list[ParkingSpot]:
        sign = 1 if side == "left" else -1
        kerb = _beside(street.line, sign * _middle_m(street, rule))
        if kerb.length < _SHORTEST_KERB_M:
            self.left_out["kerbs: too short or too winding"] += 1
            return []
        # In an angled bay one noses in as one drives: forward on the right, the other way on the left unless oneway.
        forward = side == "right" or street.way.tags.get("oneway") in ("yes", "1", "true")
        slant = sign * (1 if forward != rule.back_in else 2)
        gaps = self._gaps(street, kerb, sign)
        stretches = free_stretches(kerb.length, gaps)
        counts, step = spots_per_stretch(stretches, rule.kind, rule.capacity)
        outlines = [
            ring
            for stretch, count in zip(stretches, counts, strict=True)
            for ring in row_of_spots(kerb, stretch, count, step, rule.kind, slant)
        ]
        if not outlines:
            self.left_out["kerbs: no room between junctions"] += 1
        return [
            ParkingSpot(f"osm-w{street.way.id}-{side}-{number}", shapely.Polygon(ring), rule.kind)
            for number, ring in enumerate(outlines, start=1)
        ]

    def _gaps(self, street: _Street, kerb: shapely.LineString, sign: int) -> list[_Gap]:
        """What of a kerb stays free; sign 1 left, -1 right."""
        gaps: list[_Gap] = []
        for number, node in enumerate(street.way.nodes):
            half = self._clear_m(street, number, node, sign)
            if half > 0:
                at = kerb.project(shapely.Point(street.points[number]))
                gaps.append((at - half, at + half))
        for row in self._stop_tree.query(street.line, predicate="dwithin", distance=BUS_STOP_REACH_M).tolist():
            stop = self._stops[row]
            if _side_of(street.line, stop) == sign:
                at = kerb.project(shapely.Point(stop))
                gaps.append((at - BUS_STOP_CLEAR_M, at + BUS_STOP_CLEAR_M))
        return gaps

    def _clear_m(self, street: _Street, number: int, node: int, sign: int) -> float:
        """How far from a node the kerb on a side stays free, 0 for not at all."""
        clear = CROSSING_CLEAR_M if node in self._crossings else 0.0
        ahead = _direction(street.points, number)
        meeting = [(way, n) for way, n in self._at_node[node] if (way, n) != (street.way.id, number)]
        if len(meeting) == 1 and self._goes_on(street, number, *meeting[0]):
            return clear
        for way, n in meeting:
            other = self._streets[way]
            is_driveway = other.way.tags.get("highway") == "service"
            margin = DRIVEWAY_CLEAR_M if is_driveway else JUNCTION_CLEAR_M
            for arm in _arms(other.points, n):
                turn = float(ahead[0] * arm[1] - ahead[1] * arm[0])
                if turn * sign > np.sin(np.radians(10.0)):
                    clear = max(clear, other.width_m / 2 / max(abs(turn), 0.3) + margin)
        return clear

    def _goes_on(self, street: _Street, number: int, way: int, n: int) -> bool:
        """Whether one way ends here and the other goes on from it without a bend."""
        other = self._streets[way]
        ends = number in (0, len(street.points) - 1) and n in (0, len(other.points) - 1)
        if not ends or other.way.tags.get("highway") == "service" != street.way.tags.get("highway"):
            return False
        one, another = _arms(street.points, number)[0], _arms(other.points, n)[0]
        return bool(np.arccos(np.clip(-one @ another, -1.0, 1.0)) < _STRAIGHT_RAD)


def _beside(line: shapely.LineString, left_m: float) -> shapely.LineString:
    """The parallel to the left (negative: right), in the direction of the line; the longest piece of it."""
    curve = shapely.offset_curve(shapely.simplify(line, _SMOOTH_M), left_m, join_style="mitre")
    pieces = [part for part in shapely.get_parts(curve) if isinstance(part, shapely.LineString)]
    longest: shapely.LineString = max(pieces, key=lambda part: part.length, default=shapely.LineString())
    if longest.length == 0:
        return longest
    first, last = (line.project(shapely.Point(longest.coords[end])) for end in (0, -1))
    return longest if first <= last else shapely.reverse(longest)


def _middle_m(street: _Street, rule: KerbRule) -> float:
    """Distance from the centreline to the middle of the row of spots.

    `width` is from kerb to kerb and holds the cars that stand on the carriageway; without it there are as many lanes
    as cars drive on, and who parks on the carriageway stands beside them.
    """
    row = depth(rule.kind)
    half, inside = street.width_m / 2, "width" in street.way.tags
    if rule.position is Position.LANE and inside:
        return max(half - row / 2, row / 2)
    if rule.position is Position.HALF_ON_KERB and inside:
        return half
    return half + row / 2


def _bus_stops(nodes: tuple[OsmNode, ...], georeference: Georeference) -> NDArray[np.float64]:
    stops = [(node.lon, node.lat) for node in nodes if node.tags.get("highway") == "bus_stop"]
    return georeference.to_map(np.array(stops).reshape(-1, 2))[:, :2]


def _side_of(line: shapely.LineString, point: NDArray[np.float64]) -> int:
    """1 if a point lies left of a line, -1 right."""
    s = line.project(shapely.Point(point))
    a, b = (np.array(line.interpolate(min(max(x, 0.0), line.length)).coords[0]) for x in (s - 1.0, s + 1.0))
    ahead, away = b - a, point - a
    return 1 if ahead[0] * away[1] - ahead[1] * away[0] >= 0 else -1


def _direction(points: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """Unit direction (2,) of a line at one of its points."""
    ahead = points[min(number + 1, len(points) - 1)] - points[max(number - 1, 0)]
    return np.asarray(ahead / max(float(np.linalg.norm(ahead)), 1e-9))


def _arms(points: NDArray[np.float64], number: int) -> list[NDArray[np.float64]]:
    """Unit directions in which a line leaves one of its points."""
    arms = [points[n] - points[number] for n in (number - 1, number + 1) if 0 <= n < len(points)]
    return [arm / max(float(np.linalg.norm(arm)), 1e-9) for arm in arms]
