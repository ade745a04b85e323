"""Lanes with parking spots beside them, and the two ways to look for a free one.

Who knows where spots are free drives to the nearest one. Who does not searches exhaustively (thesis, sec. 4.4.1):
along every lane with spots until a free one is passed, lanes not driven yet before all others, none twice without need.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse.csgraph import floyd_warshall
from shapely.ops import substring

from autowaze.cloud.routing import Places, StreetGraph, TravelMode
from autowaze.world.errors import AutowazeError
from autowaze.world.streets import streets

_SAME_M = 1e-6
_FARTHEST_M = 50.0
"""Of a spot from its lane."""
_SPEED_KMH = 10.0
"""Of every lane, so that the quickest way is the shortest."""

_Step = tuple[int, int, float]
"""A lane that is driven next, the junction that it is entered from, and the metres to that junction."""


class ParkingLanes:
    """The lanes of a car park or of streets, with the spots beside them.

    Args:
        lines: centre lines of the lanes in map metres; they join where they share a position.
        spots: outlines (S,) in map metres; each is reached from the lane nearest to its outline, and seen from there.
        entrances: positions (E, 2) where cars come in; those of junctions or ends of lanes.
        oneway: whether each line may be driven in its own direction only.

    Raises:
        AutowazeError: there is no lane or no spot, or a spot lies beside no lane.
    """

    def __init__(
        self,
        lines: Sequence[shapely.LineString],
        spots: Sequence[shapely.Polygon],
        entrances: NDArray[np.floating],
        oneway: Sequence[bool] | None = None,
    ) -> None:
        if not lines or not spots:
            raise AutowazeError(f"{len(lines)} lanes and {len(spots)} spots: a search for parking needs both")
        speeds = [_SPEED_KMH] * len(lines)
        self.graph = StreetGraph(streets(lines, oneway=oneway, speed_kmh=speeds), TravelMode.DRIVING)
        self.spots = np.array(spots, dtype=np.object_)
        self.entrances = np.asarray(entrances, dtype=np.float64).reshape(-1, 2)
        self._spot_places = self._beside_lanes()
        self._entry_junctions = [self._junction_at(point) for point in self.entrances]
        self._junction_m = self._between_junctions()
        self._spots_of_lane = [np.flatnonzero(self._spot_places.edge == lane) for lane in range(len(self.graph))]

    def __len__(self) -> int:
        """How many spots there are."""
        return len(self.spots)

    def to_spots_m(self, entrance: int) -> NDArray[np.float64]:
        """Metres (S,) along lanes from an entrance to the mouth of every spot; infinite where no way leads."""
        origin = self._on_lanes(self.graph.place(self.entrances[entrance]))
        seconds = self.graph.durations(self.graph.search(origin, np.inf), self._spot_places)
        return seconds * _SPEED_KMH / 3.6

    def way_to(self, entrance: int, spot: int) -> NDArray[np.float64]:
        """Positions (K, 2) of the shortest way from an entrance to the mouth of a spot."""
        search = self.graph.search(self._on_lanes(self.graph.place(self.entrances[entrance])), np.inf)
        return self.graph.route(search, self._spot_places[np.array([spot])])[1]

    def search_m(self, entrance: int, vacant: NDArray[np.bool_], rng: np.random.Generator) -> float:
        """Metres that an exhaustive search takes to pass a vacant spot, the choice at each junction drawn.

        Args:
            entrance: where the car comes in.
            vacant: (S,) which spots are free; infinite if none of them can be reached.
            rng: of the choices.
        """
        junction, seen, driven = self._entry_junctions[entrance], frozenset[int](), 0.0
        while True:
            steps = self._next_lanes(junction, seen)
            if not steps:
                return np.inf
            lane, junction, approach_m = steps[int(rng.integers(len(steps)))]
            found_m = self._first_vacant_m(lane, junction, vacant)
            driven += approach_m
            if found_m is not None:
                return driven + found_m
            driven += float(self.graph.length_m[lane])
            junction, seen = self._other_end(lane, junction), seen | {lane}

    def longest_search(self, entrance: int, vacant: NDArray[np.bool_]) -> tuple[float, NDArray[np.float64]]:
        """Metres and positions (K, 2) of the exhaustive search that finds a vacant spot last, whatever it chooses.

        Looks at every order of the lanes: for places with some ten junctions.
        """
        metres, steps = self._longest(self._entry_junctions[entrance], frozenset(), vacant)
        return metres, self._drawn(self._entry_junctions[entrance], steps, vacant)

    def _longest(
        self, junction: int, seen: frozenset[int], vacant: NDArray[np.bool_]
    ) -> tuple[float, list[tuple[int, int]]]:
        best: tuple[float, list[tuple[int, int]]] = (-np.inf, [])
        for lane, start, approach_m in self._next_lanes(junction, seen):
            metres = self._first_vacant_m(lane, start, vacant)
            rest: list[tuple[int, int]] = []
            if metres is None:
                metres, rest = self._longest(self._other_end(lane, start), seen | {lane}, vacant)
                metres += float(self.graph.length_m[lane])
            if approach_m + metres > best[0]:
                best = (approach_m + metres, [(lane, start), *rest])
        return best if best[1] else (np.inf, [])

    def _next_lanes(self, junction: int, seen: frozenset[int]) -> list[_Step]:
        """Lanes with spots not driven yet: those that begin here, else those at the nearest junction that has some."""
        steps = []
        for lane, spots in enumerate(self._spots_of_lane):
            if lane not in seen and len(spots):
                starts = {int(self.graph.begin[lane])}
                starts |= {int(self.graph.end[lane])} if self.graph.both_ways[lane] else set()
                steps += [(lane, start, float(self._junction_m[junction, start])) for start in sorted(starts)]
        nearest = min((approach_m for _, _, approach_m in steps), default=np.inf)
        return [step for step in steps if step[2] < nearest + _SAME_M and np.isfinite(step[2])]

    def _first_vacant_m(self, lane: int, start: int, vacant: NDArray[np.bool_]) -> float | None:
        """Metres from an end of a lane to the first vacant spot beside it."""
        rows = self._spots_of_lane[lane]
        along = self._spot_places.along_m[rows[vacant[rows]]]
        if not len(along):
            return None
        forwards = start == self.graph.begin[lane]
        return float(along.min() if forwards else self.graph.length_m[lane] - along.max())

    def _other_end(self, lane: int, start: int) -> int:
        begin, end = int(self.graph.begin[lane]), int(self.graph.end[lane])
        return end if start == begin else begin

    def _beside_lanes(self) -> Places:
        tree = shapely.STRtree(self.graph.lines)
        row, found = tree.query_nearest(self.spots, max_distance=_FARTHEST_M, all_matches=False)
        if len(row) < len(self.spots):
            missing = int(np.setdiff1d(np.arange(len(self.spots)), row)[0])
            raise AutowazeError(f"spot {missing} lies more than {_FARTHEST_M:g} m from every lane")
        edge = np.empty(len(self.spots), np.int64)
        edge[row] = found
        along = shapely.line_locate_point(self.graph.lines[edge], shapely.centroid(self.spots))
        mouth = shapely.get_coordinates(shapely.line_interpolate_point(self.graph.lines[edge], along))
        return Places(mouth, edge, along, np.zeros(len(self.spots)))

    def _on_lanes(self, places: Places) -> Places:
        return Places(places.position, places.edge, places.along_m, np.zeros(len(places.edge)))

    def _ends(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Junctions (2N,) and positions (2N, 2) of the beginnings and ends of all lanes."""
        points = [shapely.get_coordinates(shapely.get_point(self.graph.lines, which)) for which in (0, -1)]
        return np.concatenate([self.graph.begin, self.graph.end]), np.concatenate(points)

    def _junction_at(self, point: NDArray[np.float64]) -> int:
        junctions, points = self._ends()
        return int(junctions[np.argmin(np.hypot(*(points - point).T))])

    def _between_junctions(self) -> NDArray[np.float64]:
        """Metres (J, J) of the shortest ways between junctions."""
        count = int(max(self.graph.begin.max(), self.graph.end.max())) + 1
        direct = np.full((count, count), np.inf)
        back = self.graph.both_ways
        np.minimum.at(direct, (self.graph.begin, self.graph.end), self.graph.length_m)
        np.minimum.at(direct, (self.graph.end[back], self.graph.begin[back]), self.graph.length_m[back])
        np.fill_diagonal(direct, 0.0)
        return np.asarray(floyd_warshall(direct), dtype=np.float64)

    def _drawn(self, junction: int, steps: list[tuple[int, int]], vacant: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Positions (K, 2) of a search, the ways to lanes that lie apart included."""
        junctions, points = self._ends()
        where = {int(name): point for name, point in zip(junctions, points, strict=True)}
        parts = [where[junction][None]]
        for lane, start in steps:
            if start != junction:
                origin = self._on_lanes(self.graph.place(where[junction]))
                goal = self._on_lanes(self.graph.place(where[start]))
                parts.append(self.graph.route(self.graph.search(origin, np.inf), goal)[1])
            line = self.graph.lines[lane]
            line = line if start == self.graph.begin[lane] else shapely.reverse(line)
            found_m = self._first_vacant_m(lane, start, vacant)
            length = float(self.graph.length_m[lane]) if found_m is None else found_m
            parts.append(shapely.get_coordinates(substring(line, 0.0, length)))
            junction = self._other_end(lane, start)
        return np.concatenate(parts)
