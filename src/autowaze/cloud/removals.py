"""Who said of which features that they are gone, as long as that is not settled.

A removal may come before the feature itself, and what cars localise by goes only when two of them miss it. Votes are
kept per block of features, and which features they condemn depends on the set of votes alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.diff_kernels import among
from autowaze.cloud.validation import RefusedDiffError
from autowaze.cloud.witnesses import SURVEY
from autowaze.world.feature_map import MapFeatures
from autowaze.world.labels import is_movable

MOST_PENDING = 1 << 22
"""Votes that wait for features or for a second vote; more than this is no reordering but an attack."""
MOST_PENDING_OF_SOURCE = 1 << 18
ENOUGH_VOICES = 2


class _Vote(NamedTuple):
    """Ids (K,) ascending that a source misses, and the ends (K,) of the last windows in which it missed each."""

    ids: NDArray[np.uint64]
    end: NDArray[np.float64]


class RemovalVotes:
    """Votes by block and source.

    Args:
        corroboration: a feature of what stands goes when its own source or two others miss it, and nobody misses
            what was first seen later (a survey may have been made by another clock); else one vote is enough.
    """

    def __init__(self, corroboration: bool = False) -> None:
        self._corroboration = corroboration
        self._votes: dict[int, dict[int, _Vote]] = {}
        self._of_source: dict[int, int] = {}
        self._pending = 0

    def require_room(self, count: int, source: int) -> None:
        """Refuse more votes of a source than can be waited for, with `RefusedDiffError`."""
        of_source = self._of_source.get(source, 0)
        if self._pending + count > MOST_PENDING or of_source + count > MOST_PENDING_OF_SOURCE:
            raise RefusedDiffError(
                "too many features removed that are not in the map; send the additions first", "too_many_removals"
            )

    def add(self, number: int, ids: NDArray[np.uint64], source: int, end: float) -> None:
        """Note that a source misses features (K,) ascending of a block at the end of a window."""
        votes = self._votes.setdefault(number, {})
        before = votes.get(source)
        if before is None:
            votes[source] = _Vote(ids, np.full(len(ids), end))
            self._count(source, len(ids))
            return
        voted, ends = np.append(before.ids, ids), np.append(before.end, np.full(len(ids), end))
        order = np.lexsort((ends, voted))
        newest = order[np.append(voted[order[1:]] != voted[order[:-1]], True)]
        votes[source] = _Vote(voted[newest], ends[newest])
        self._count(source, len(newest) - len(before.ids))

    def condemned(self, number: int, block: MapFeatures, owner: int) -> NDArray[np.bool_]:
        """Which features (N,) of a block that a source brought are gone by the votes on it."""
        gone, voices = np.zeros(len(block), np.bool_), np.zeros(len(block), np.int64)
        votes = self._votes.get(number)
        if not votes:
            return gone
        for source, vote in votes.items():
            row = np.searchsorted(vote.ids, block.id).clip(max=len(vote.ids) - 1)
            missed = vote.ids[row] == block.id
            if not self._corroboration or source == owner:
                gone |= missed
            else:
                voices += missed & ((block.first_seen <= vote.end[row]) | (owner == SURVEY))
        return gone | (voices >= np.where(is_movable(block.label), 1, ENOUGH_VOICES))

    def settle(self, number: int, left: NDArray[np.uint64]) -> None:
        """Keep the votes on what is left (N,) ascending of a block that has arrived; the others are settled."""
        for source, vote in self._votes.pop(number, {}).items():
            waits = among(vote.ids, left)
            self._count(source, int(waits.sum()) - len(waits))
            if waits.any():
                self._votes.setdefault(number, {})[source] = _Vote(vote.ids[waits], vote.end[waits])

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot."""
        return {
            "votes": {n: {s: (vote.ids, vote.end) for s, vote in votes.items()} for n, votes in self._votes.items()}
        }

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""
        self._votes, self._of_source, self._pending = {}, {}, 0
        for number, votes in kept["votes"].items():
            self._votes[number] = {source: _Vote(ids, end) for source, (ids, end) in votes.items()}
            for source, vote in self._votes[number].items():
                self._count(source, len(vote.ids))

    def _count(self, source: int, more: int) -> None:
        self._pending += more
        self._of_source[source] = self._of_source.get(source, 0) + more
        if self._of_source[source] == 0:
            del self._of_source[source]
