"""The benefits as a distribution: seeded searches over many places and occupancies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.evaluation.benefits.costs import Rates
from autowaze.evaluation.benefits.places import PlaceKind, draw_place
from autowaze.evaluation.benefits.thesis_lot import ThesisLot

THESIS_FIGURES = {
    "without_m": 195.0,
    "without_s": 43.65,
    "without_gal": 0.0048,
    "without_usd": 0.0168,
    "with_m": 35.0,
    "with_s": 7.83,
    "with_gal": 0.00088,
    "with_usd": 0.0031,
    "saved_fraction": 0.821,
}
"""As the thesis prints them (sec. 4.4), to be shown beside ours."""

_RESAMPLES = 1000
_DIGITS = 6
"""Of metres: two ways of adding up the same lanes give the same length."""


@dataclass(frozen=True)
class SearchLengths:
    """N searches for a spot, each by both drivers from the same entrance among the same parked cars.

    Attributes:
        without_m: (N,) float64, of who searches exhaustively.
        with_m: (N,) float64, of who drives to the nearest vacant spot.
        place: (N,) int64, number of the place: searches in one place are not independent.
    """

    without_m: NDArray[np.float64]
    with_m: NDArray[np.float64]
    place: NDArray[np.int64]

    @property
    def saved_fraction(self) -> float:
        """Share of all metres that knowing saves."""
        return _saved(self.without_m.sum(), self.with_m.sum())

    def saved_interval(self, rng: np.random.Generator) -> tuple[float, float]:
        """95 % interval of the saved share: bootstrap over places."""
        places = int(self.place.max()) + 1
        sums = np.stack([np.bincount(self.place, m, places) for m in (self.without_m, self.with_m)])
        drawn = sums[:, rng.integers(0, places, (_RESAMPLES, places))].sum(axis=2)
        low, high = np.percentile([_saved(*pair) for pair in drawn.T], [2.5, 97.5])
        return float(low), float(high)

    def metrics(self, rates: Rates, rng: np.random.Generator) -> dict[str, float]:
        """Flat names for reports."""
        low, high = self.saved_interval(rng)
        saved_m = float((self.without_m - self.with_m).mean())
        out = {"searches": float(len(self.with_m))}
        for name, metres in (("without", self.without_m), ("with", self.with_m)):
            out[f"{name}_mean_m"] = float(metres.mean())
            out[f"{name}_median_m"] = float(np.median(metres))
            out[f"{name}_p95_m"] = float(np.percentile(metres, 95))
        out |= rates.metrics(saved_m, "saved_mean")
        return out | {"saved_fraction": self.saved_fraction, "saved_low": low, "saved_high": high}


def thesis_metrics(lot: ThesisLot, rates: Rates) -> dict[str, float]:
    """The thesis's arithmetic on its car park, each length from the lanes."""
    with_m = float(lot.lanes.to_spots_m(0)[lot.vacant].min())
    without_m, _ = lot.lanes.longest_search(0, lot.vacant)
    out = rates.metrics(without_m, "without") | rates.metrics(with_m, "with")
    return out | {"saved_fraction": _saved(without_m, with_m)}


def drawn_searches(lot: ThesisLot, searches: int, seed: int) -> SearchLengths:
    """The same car park, the choices of who searches drawn instead of the unluckiest."""
    rng = np.random.default_rng([seed, 0])
    without_m = [lot.lanes.search_m(0, lot.vacant, rng) for _ in range(searches)]
    with_m = np.full(searches, lot.lanes.to_spots_m(0)[lot.vacant].min())
    return SearchLengths(np.array(without_m), with_m, np.arange(searches))


def search_places(
    kind: PlaceKind, occupancies: Sequence[float], places: int, searches: int, seed: int
) -> dict[float, SearchLengths]:
    """Searches in places of one kind, by occupancy; every number follows from the seed.

    Args:
        kind: of the places.
        occupancies: shares of the spots that are taken; at least one spot stays free.
        places: how many are drawn.
        searches: in each of them, each with its own parked cars and entrance.
        seed: of everything.
    """
    gathered: dict[float, list[tuple[float, float, int]]] = {occupancy: [] for occupancy in occupancies}
    for number in range(places):
        rng = np.random.default_rng([seed, 1 + list(PlaceKind).index(kind), number])
        lanes = draw_place(kind, rng)
        to_spots = np.stack([lanes.to_spots_m(entrance) for entrance in range(len(lanes.entrances))])
        for occupancy in occupancies:
            for _ in range(searches):
                vacant, entrance = _vacant(len(lanes), occupancy, rng), int(rng.integers(len(to_spots)))
                without_m = lanes.search_m(entrance, vacant, rng)
                gathered[occupancy].append((without_m, float(to_spots[entrance, vacant].min()), number))
    return {occupancy: _columns(rows) for occupancy, rows in gathered.items()}


def _vacant(spots: int, occupancy: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which spots are free, (S,), as the simulator parks cars."""
    taken = min(round(occupancy * spots), spots - 1)
    return np.asarray(rng.permutation(spots) >= taken)


def _columns(rows: list[tuple[float, float, int]]) -> SearchLengths:
    without_m, with_m, place = (np.array(column) for column in zip(*rows, strict=True))
    return SearchLengths(np.round(without_m, _DIGITS), np.round(with_m, _DIGITS), place)


def _saved(without_m: float, with_m: float) -> float:
    return float(1.0 - with_m / without_m) if without_m > 0 else 0.0
