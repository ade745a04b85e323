"""Ways along streets: a graph of what may be walked or driven, and the quickest ways from one place to many."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely.ops import substring

from autowaze.cloud.street_joints import Pieces, pieces_between_joints
from autowaze.world.streets import Streets

WALKING_MPS = 1.4
"""Comfortable gait (Bohannon 1997, Age and Ageing 26)."""
STRAIGHT_DRIVING_MPS = 30.0 / 3.6
"""Where no streets are known."""
ASIDE_DRIVING_MPS = 3.0
"""Between the middle of a street and what lies beside it."""
FARTHEST_ASIDE_M = 300.0
"""What lies farther from every street cannot be reached along them."""
_LEAST_S = 1e-6  # csgraph takes a zero for no arc


class TravelMode(StrEnum):
    """How one moves."""

    WALKING = "walking"
    DRIVING = "driving"


@dataclass(frozen=True)
class Places:
    """N places with their way to the nearest street.

    Attributes:
        position: (N, 2) float64, map metres.
        edge: (N,) int64, edge of the graph, -1 if all are too far away.
        along_m: (N,) float64, where on the edge, from its beginning.
        aside_m: (N,) float64, distance from it.
    """

    position: NDArray[np.float64]
    edge: NDArray[np.int64]
    along_m: NDArray[np.float64]
    aside_m: NDArray[np.float64]

    def __getitem__(self, rows: NDArray[np.int64]) -> Places:
        return Places(self.position[rows], self.edge[rows], self.along_m[rows], self.aside_m[rows])


@dataclass(frozen=True)
class Search:
    """The quickest ways from one place to every junction within a time.

    Attributes:
        origin: one place.
        seconds: (2, J) from the end and from the beginning of the origin's edge on; infinite where it is too far.
        before: (2, J) int32, the junction before.
    """

    origin: Places
    seconds: NDArray[np.float64]
    before: NDArray[np.int32]


class StreetGraph:
    """Junctions and the edges between them, for one way of moving.

    Args:
        streets: in map metres; they join where they share a position, and where one ends within a metre of another.
        mode: who walks goes both ways along every street; who drives heeds one-way streets and speeds.
    """

    def __init__(self, streets: Streets, mode: TravelMode) -> None:
        used = streets[streets.walking if mode is TravelMode.WALKING else streets.driving]
        pieces: Pieces = pieces_between_joints(used.line)
        self.mode = mode
        self.lines = pieces.line
        self.begin, self.end = pieces.begin, pieces.end
        self.length_m = shapely.length(self.lines)
        walking = mode is TravelMode.WALKING
        speed_mps = np.full(len(used), WALKING_MPS) if walking else used.speed_kmh / 3.6
        self.seconds = self.length_m / speed_mps[pieces.street]
        self.both_ways = np.ones(len(self.lines), np.bool_) if walking else ~used.oneway[pieces.street]
        self.fastest_mps = float(speed_mps.max(initial=WALKING_MPS if walking else ASIDE_DRIVING_MPS))
        self.aside_mps = WALKING_MPS if walking else ASIDE_DRIVING_MPS
        self._tree = shapely.STRtree(self.lines)
        self._arcs, self._edge_of_arc = self._quickest_arcs(pieces.joints)

    def __len__(self) -> int:
        """How many edges there are."""
        return len(self.lines)

    def place(self, points: NDArray[np.float64]) -> Places:
        """Points (N, 2) in map metres with the nearest edge."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        edge, aside = np.full(len(points), -1, np.int64), np.zeros(len(points))
        if len(self.lines):
            (row, found), distance = self._tree.query_nearest(
                shapely.points(points), max_distance=FARTHEST_ASIDE_M, return_distance=True, all_matches=False
            )
            edge[row], aside[row] = found, distance
        along = np.zeros(len(points))
        near = edge >= 0
        along[near] = shapely.line_locate_point(self.lines[edge[near]], shapely.points(points[near]))
        return Places(points, edge, along, aside)

    def search(self, origin: Places, limit_s: float) -> Search:
        """Ways from one place that has an edge; junctions farther than the limit are not reached."""
        edge = int(origin.edge[0])
        # Two junctions to set out from: the end of the edge, and, if it may be gone against, its beginning.
        starts = np.array([self.end[edge], self.begin[edge]])
        seconds, before = dijkstra(self._arcs, indices=starts, limit=limit_s, return_predecessors=True)
        share = float(origin.along_m[0]) / max(float(self.length_m[edge]), _LEAST_S)
        seconds[0] += (1.0 - share) * self.seconds[edge]
        seconds[1] += share * self.seconds[edge] if self.both_ways[edge] else np.inf
        return Search(origin, seconds, before)

    def durations(self, search: Search, places: Places) -> NDArray[np.float64]:
        """Seconds (N,) from the origin to places; infinite where a place was not reached."""
        ways = self._ways(search, places)
        asides_m = search.origin.aside_m[0] + places.aside_m
        return np.asarray(ways.min(axis=0, initial=np.inf) + asides_m / self.aside_mps)

    def route(self, search: Search, place: Places) -> tuple[float, NDArray[np.float64]]:
        """Length in metres and positions (K, 2) of the quickest way to one place that was reached."""
        ways = self._ways(search, place)[:, 0]
        chosen = int(np.argmin(ways))
        origin, source, target = search.origin, int(search.origin.edge[0]), int(place.edge[0])
        start_m, goal_m = float(origin.along_m[0]), float(place.along_m[0])
        if chosen == 4:
            parts = [substring(self.lines[source], start_m, goal_m)]
        else:
            out, into = divmod(chosen, 2)
            leave_at = float(self.length_m[source]) if out == 0 else 0.0
            enter_at = 0.0 if into == 0 else float(self.length_m[target])
            enter = int(self.begin[target] if into == 0 else self.end[target])
            parts = [
                substring(self.lines[source], start_m, leave_at),
                *self._between(search.before[out], enter),
                substring(self.lines[target], enter_at, goal_m),
            ]
        points = np.concatenate([origin.position, *(shapely.get_coordinates(part) for part in parts), place.position])
        points = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 1e-3)]
        return float(np.hypot(*np.diff(points, axis=0).T).sum()), points

    def _ways(self, search: Search, places: Places) -> NDArray[np.float64]:
        """Seconds (5, N) along streets: out by the end or the beginning, in by the beginning or the end; or direct."""
        on_edge = places.edge >= 0
        edge = np.where(on_edge, places.edge, 0)
        share = np.clip(places.along_m / np.maximum(self.length_m[edge], _LEAST_S), 0.0, 1.0)
        from_begin = share * self.seconds[edge]
        from_end = np.where(self.both_ways[edge], (1.0 - share) * self.seconds[edge], np.inf)
        begin, end = search.seconds[:, self.begin[edge]] + from_begin, search.seconds[:, self.end[edge]] + from_end
        source = int(search.origin.edge[0])
        ahead_m = places.along_m - search.origin.along_m[0]
        speed_mps = self.length_m[source] / max(float(self.seconds[source]), _LEAST_S)
        reachable = (edge == source) & ((ahead_m >= 0.0) | self.both_ways[source])
        direct = np.where(reachable, np.abs(ahead_m) / max(speed_mps, _LEAST_S), np.inf)
        ways = np.stack([begin[0], end[0], begin[1], end[1], direct])
        return np.where(on_edge, ways, np.inf)

    def _between(self, before: NDArray[np.int32], goal: int) -> list[shapely.LineString]:
        """The edges to a junction, in order and each in the direction in which it is gone along."""
        parts = []
        while before[goal] >= 0:
            previous = int(before[goal])
            first, last = self._arcs.indptr[previous : previous + 2]
            arc = first + int(np.searchsorted(self._arcs.indices[first:last], goal))
            edge = int(self._edge_of_arc[arc])
            parts.append(self.lines[abs(edge) - 1] if edge > 0 else self.lines[abs(edge) - 1].reverse())
            goal = previous
        return parts[::-1]

    def _quickest_arcs(self, joints: int) -> tuple[csr_array, NDArray[np.int64]]:
        """Seconds from junction to junction, and the edge of each arc, counted from 1, negative against the line."""
        edges = np.arange(1, len(self.lines) + 1)
        back = self.both_ways
        begin, end = np.append(self.begin, self.end[back]), np.append(self.end, self.begin[back])
        seconds = np.maximum(np.append(self.seconds, self.seconds[back]), _LEAST_S)
        edge = np.append(edges, -edges[back])
        order = np.lexsort((seconds, end, begin))  # of parallel edges the quickest comes first
        begin, end, seconds, edge = begin[order], end[order], seconds[order], edge[order]
        first = np.append(True, (begin[1:] != begin[:-1]) | (end[1:] != end[:-1]))[: len(order)]
        begin, end, seconds, edge = begin[first], end[first], seconds[first], edge[first]
        return csr_array((seconds, (begin, end)), shape=(joints, joints)), edge
