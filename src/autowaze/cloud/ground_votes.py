"""What cars saw of the ground of each spot, window by window."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.cloud.cell_kernels import any_between, cells_ascend, votes_of_codes
from autowaze.cloud.spots import SpotIndex, raster_of, without_row
from autowaze.world.ground import GroundCells
from autowaze.world.map_diff import SemanticMapDiff

MAX_WINDOWS = 8
"""Windows kept per spot, the newest; which ones does not depend on the order of arrival."""


class WindowVotes(NamedTuple):
    """What one window saw of a spot.

    `free` and `obstacle` are (C,) uint8 frames per cell of the spot's raster, saturating; `sigma_m` is one standard
    deviation of the car's position; `source` is whose word it is.
    """

    end: float
    session: int
    sequence: int
    sigma_m: float
    free: NDArray[np.uint8]
    obstacle: NDArray[np.uint8]
    source: int = 0

    @property
    def key(self) -> tuple[float, int, int]:
        """Order of the windows."""
        return self.end, self.session, self.sequence


@dataclass(frozen=True, slots=True)
class _SpotWindows:
    """What is kept of one spot, for a snapshot: all votes in one array."""

    windows: list[WindowVotes]

    @property
    def plain(self) -> tuple[Any, ...]:
        """(told, votes): all but the votes of each window, and the votes (W, 2, C)."""
        told = [(w.end, w.session, w.sequence, w.sigma_m, w.source) for w in self.windows]
        return told, np.array([(w.free, w.obstacle) for w in self.windows])

    @classmethod
    def of_plain(cls, plain: list[Any]) -> _SpotWindows:
        """Back from a snapshot; each window has its votes for itself."""
        windows = []
        for (end, session, sequence, sigma_m, source), (free, obstacle) in zip(*plain, strict=True):
            windows.append(WindowVotes(end, session, sequence, sigma_m, free.copy(), obstacle.copy(), source))
        return cls(windows)


class GroundVotes:
    """Ground cells of diffs, sorted into the spots that they lie in.

    Args:
        spots: the spots.
        crowding_s: each window of a source counts as so much older than the one after it, when the newest are chosen:
            who looks often does not crowd out what others saw. 0 keeps the newest, whoever saw them.
    """

    def __init__(self, spots: SpotIndex, crowding_s: float = 0.0) -> None:
        self._spots = spots
        self._crowding_s = crowding_s
        self._windows: dict[int, list[WindowVotes]] = {}

    def add(self, diff: SemanticMapDiff, source: int = 0) -> NDArray[np.int64]:
        """Note the ground of one diff of a source; returns the spots (T,) of which it saw something, sorted."""
        candidates = self._spots.grid.around_cells(diff.ground.ix, diff.ground.iy)
        if len(candidates) == 0:
            return candidates
        rasters = [self._spots.raster(spot).codes for spot in candidates.tolist()]
        votes = _look_up(diff.ground, np.concatenate(rasters))
        starts = np.cumsum([0, *map(len, rasters)])
        seen = np.flatnonzero(any_between(votes, starts))
        for row in seen.tolist():
            # A copy: a view would keep the cells of all spots around for as long as one of them keeps its own.
            free, obstacle = votes[:, starts[row] : starts[row + 1]].copy()
            window = (diff.end, diff.session, diff.sequence, diff.position_sigma_m, free, obstacle)
            self._note(int(candidates[row]), WindowVotes(*window, source))
        return candidates[seen]

    def windows(self, spot: int) -> list[WindowVotes]:
        """What is kept of a spot, oldest first."""
        return self._windows.get(spot, [])

    def seen_share(self, spot: int) -> float:
        """Share of the spot's cells that any window saw, 0..1."""
        seen = [window.free | window.obstacle for window in self.windows(spot)]
        return float(np.mean(np.bitwise_or.reduce(seen) > 0)) if seen else 0.0

    def seen_in(self, polygon: shapely.Polygon) -> list[WindowVotes]:
        """What is kept of the ground in any outline, oldest first: all that the spots there know of it."""
        codes = raster_of(polygon).codes
        windows: dict[tuple[float, int, int], WindowVotes] = {}
        for spot in self._spots.around(np.array(polygon.bounds)).tolist():
            own = self._spots.raster(spot).codes
            if len(own) == 0:
                continue
            row = np.searchsorted(own, codes).clip(max=len(own) - 1)
            hit = own[row] == codes
            for window in self.windows(spot):
                nothing = np.zeros(len(codes), np.uint8)
                known = windows.get(window.key, window._replace(free=nothing, obstacle=nothing))
                free, obstacle = (
                    np.maximum(known.free, window.free[row] * hit),
                    np.maximum(known.obstacle, window.obstacle[row] * hit),
                )
                if (free | obstacle).any():
                    windows[window.key] = known._replace(free=free, obstacle=obstacle)
        return [windows[key] for key in sorted(windows)][-MAX_WINDOWS:]

    def drawn(self, spot: int, windows: list[WindowVotes]) -> None:
        """Keep these windows of a spot that was drawn anew, oldest first."""
        self._windows[spot] = windows

    def erased(self, spot: int) -> None:
        """Forget a spot; later ones move up by one."""
        self._windows = without_row(self._windows, spot)

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot: lists of windows by row of the spot."""
        return {"windows": {spot: _SpotWindows(windows) for spot, windows in self._windows.items()}}

    def restore(self, kept: dict[str, Any], row_now: dict[int, int]) -> None:
        """Hold what a snapshot kept, of those rows that a spot still has or has now."""
        self._windows = {
            row_now[spot]: _SpotWindows.of_plain(plain).windows
            for spot, plain in kept["windows"].items()
            if spot in row_now
        }

    def _note(self, spot: int, window: WindowVotes) -> None:
        kept = sorted([*self._windows.get(spot, []), window], key=lambda w: w.key)
        if len(kept) > MAX_WINDOWS:
            # A window's rank only grows as others arrive, so which ones stay does not depend on the order.
            del kept[self._oldest(kept)]
        self._windows[spot] = kept

    def _oldest(self, windows: list[WindowVotes]) -> int:
        """Row of the window, of some in the order of their keys, that can best be spared."""
        if self._crowding_s == 0.0:
            return 0
        later: dict[int, int] = {}
        spared = (math.inf, 0)
        for row in range(len(windows) - 1, -1, -1):
            window = windows[row]
            rank = later[window.source] = later.get(window.source, -1) + 1
            spared = min(spared, (window.end - self._crowding_s * rank, row))
        return spared[1]


def _look_up(ground: GroundCells, codes: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Votes (2, C) for the cells with these codes, free and obstacle, 0 for cells that were not seen."""
    if not cells_ascend(ground.ix, ground.iy):
        ground = ground[np.lexsort((ground.ix, ground.iy))]
    votes: NDArray[np.uint8] = votes_of_codes(ground.ix, ground.iy, ground.free, ground.obstacle, codes)
    return votes
