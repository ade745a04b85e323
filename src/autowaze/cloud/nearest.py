"""The vacant spots that are best gone to from a place: near, and likely still free when one arrives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.belief import DECIDED, faded_probability
from autowaze.cloud.routing import STRAIGHT_DRIVING_MPS, WALKING_MPS, Places, StreetGraph, TravelMode
from autowaze.world.streets import StreetNetwork

SEARCH_S = 486.0
"""What it costs to find a spot taken: the mean time of a search for another one, 8.1 minutes (Shoup 2006, Transport
Policy 13, table 1)."""
BUDGETS_S = (120.0, 240.0, 480.0, 960.0, 1920.0)
"""How far one looks; farther only if better spots may lie there."""
MOST_CANDIDATES = 10_000
"""Spots that are looked at, the nearest as the crow flies."""

Vacancy = Callable[[NDArray[np.int64]], NDArray[np.float64]]
"""Probability (N,) that each of these rows (N,) is vacant now."""


@dataclass(frozen=True)
class Choice:
    """A spot and the way to it.

    Attributes:
        row: of the spot.
        probability_vacant, probability_on_arrival: now, and when one gets there.
        expected_s: seconds until one has parked: the way, and the search for another spot if this one is taken.
        path: (K, 2) float64, map metres, from the place to the middle of the spot.
    """

    row: int
    distance_m: float
    duration_s: float
    probability_vacant: float
    probability_on_arrival: float
    expected_s: float
    path: NDArray[np.float64]


@dataclass(frozen=True)
class SpotPlaces:
    """The spots of one parking map.

    Attributes:
        centre: (S, 2) float64, their middles in map metres.
        on_streets: the same with the nearest street, for each mode with streets.
    """

    centre: NDArray[np.float64]
    on_streets: dict[TravelMode, Places]


class SpotFinder:
    """Finds spots along streets, or as the crow flies where no street is known.

    Args:
        network: the streets, in the frame of the spots.
    """

    def __init__(self, network: StreetNetwork | None) -> None:
        modes = TravelMode if network is not None else ()
        graphs = {mode: StreetGraph(network.streets, mode) for mode in modes if network is not None}
        self._graphs = {mode: graph for mode, graph in graphs.items() if len(graph)}

    def place(self, centre: NDArray[np.float64]) -> SpotPlaces:
        """The spots with these middles (S, 2), ready to be found; costs all of them."""
        return SpotPlaces(centre, {mode: graph.place(centre) for mode, graph in self._graphs.items()})

    def nearest(
        self, point: NDArray[np.float64], mode: TravelMode, limit: int, spots: SpotPlaces, vacancy: Vacancy
    ) -> tuple[bool, list[Choice]]:
        """The best spots of those more likely vacant than not, best first, and whether the ways are along streets.

        They are ranked by `expected_s`, the time until one has parked: t + (1 - p) * `SEARCH_S`, where t is the
        duration of the way and p the probability on arrival.
        """
        if mode in self._graphs:
            origin = self._graphs[mode].place(point)
            if origin.edge[0] >= 0:
                found = _along_streets(self._graphs[mode], origin, spots.on_streets[mode], limit, vacancy)
                if found:
                    return True, found
        return False, _as_the_crow_flies(np.asarray(point, dtype=np.float64), spots.centre, mode, limit, vacancy)


def _along_streets(graph: StreetGraph, origin: Places, spots: Places, limit: int, vacancy: Vacancy) -> list[Choice]:
    for budget_s in BUDGETS_S:
        rows = _within(origin.position[0], spots.position, budget_s * graph.fastest_mps)
        rows, vacant = _likely_vacant(rows, vacancy)
        search = graph.search(origin, budget_s)
        duration = graph.durations(search, spots[rows])
        ranked = _ranked(rows, vacant, duration, limit)
        # Whatever lies beyond takes longer than the budget, so it cannot cost less.
        if len(ranked) == limit and ranked[-1][0] <= budget_s:
            break
    choices = []
    for expected_s, row, duration_s, now, then in ranked:
        distance_m, path = graph.route(search, spots[np.array([row])])
        choices.append(Choice(row, distance_m, duration_s, now, then, expected_s, path))
    return choices


def _as_the_crow_flies(
    point: NDArray[np.float64], centre: NDArray[np.float64], mode: TravelMode, limit: int, vacancy: Vacancy
) -> list[Choice]:
    speed_mps = WALKING_MPS if mode is TravelMode.WALKING else STRAIGHT_DRIVING_MPS
    rows, vacant = _likely_vacant(_within(point, centre, BUDGETS_S[-1] * speed_mps), vacancy)
    distance = np.hypot(*(centre[rows] - point).T)
    return [
        Choice(row, duration_s * speed_mps, duration_s, now, then, expected_s, np.stack([point, centre[row]]))
        for expected_s, row, duration_s, now, then in _ranked(rows, vacant, distance / speed_mps, limit)
    ]


def _within(point: NDArray[np.float64], centre: NDArray[np.float64], radius_m: float) -> NDArray[np.int64]:
    """Rows of the spots in a circle, the nearest of them if there are many."""
    offset = centre - point
    squared = np.einsum("ij,ij->i", offset, offset)
    rows = np.flatnonzero(squared <= radius_m**2)
    if len(rows) > MOST_CANDIDATES:
        rows = np.sort(rows[np.argpartition(squared[rows], MOST_CANDIDATES)[:MOST_CANDIDATES]])
    return rows


def _likely_vacant(rows: NDArray[np.int64], vacancy: Vacancy) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    vacant = vacancy(rows)
    likely = vacant >= DECIDED
    return rows[likely], vacant[likely]


def _ranked(
    rows: NDArray[np.int64], vacant: NDArray[np.float64], duration_s: NDArray[np.float64], limit: int
) -> list[tuple[float, int, float, float, float]]:
    """The best: expected seconds, row, duration, probability now and on arrival."""
    reached = np.isfinite(duration_s)
    rows, vacant, duration_s = rows[reached], vacant[reached], duration_s[reached]
    then = faded_probability(vacant, duration_s)
    expected = duration_s + (1.0 - then) * SEARCH_S
    best = np.lexsort((rows, expected))[:limit]
    columns = (expected, rows, duration_s, vacant, then)
    return list(zip(*(column[best].tolist() for column in columns), strict=True))
