"""Which features of the stored map are gone rather than missed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.vehicle.diffing.visibility import Sight


@dataclass(frozen=True)
class LookedFor:
    """What the frames of a window say about stored features, N rows sorted by landmark id.

    Attributes:
        map_id: (N,) uint64, id in the stored map.
        position: (N, 3) float64, metres, map frame.
        instance_key: (N,) uint64, the instance that it belongs to; 0 for background.
        matched: (N,) int64, frames that matched it.
        sights: (N, 4) int64, frames by `Sight` in which it was predicted visible and not matched.
    """

    map_id: NDArray[np.uint64]
    position: NDArray[np.float64]
    instance_key: NDArray[np.uint64]
    matched: NDArray[np.int64]
    sights: NDArray[np.int64]

    @classmethod
    def empty(cls) -> LookedFor:
        """Nothing was looked for."""
        return cls(
            np.zeros(0, np.uint64),
            np.zeros((0, 3)),
            np.zeros(0, np.uint64),
            np.zeros(0, np.int64),
            np.zeros((0, len(Sight)), np.int64),
        )

    @property
    def missed(self) -> NDArray[np.int64]:
        """Frames (N,) that should have seen it and did not; those where something hides it do not count."""
        return np.asarray(self.sights.sum(axis=1) - self.sights[:, Sight.HIDDEN])


def removed_features(seen: LookedFor, settings: DiffSettings) -> NDArray[np.bool_]:
    """Mask (N,) of the features that are gone.

    A single miss says little: corners flicker, and some are never found again. A feature is gone when it was looked
    for often enough, never matched, and either stereo sees through where it stood in most of those frames, or its
    group - the instance it belongs to, or its neighbourhood - is missing as a whole while the rest of the map
    matches. An instance leaves as a whole, so then all of its features go that do not match, and a surface in its
    place is another vehicle; in the background a surface in its place is the old one in other light.
    """
    looked_for = seen.matched + seen.missed
    judged = looked_for >= settings.min_visible_frames
    if not judged.any():
        return judged
    match_ratio = np.count_nonzero(judged & (seen.matched > 0)) / np.count_nonzero(judged)
    if match_ratio < settings.min_match_ratio:
        return np.zeros(len(judged), np.bool_)
    unmatched = seen.matched == 0
    seen_through = judged & unmatched & (2 * seen.sights[:, Sight.THROUGH] > seen.missed)
    absent_group = _absent_groups(_groups(seen, settings), judged, unmatched, settings)
    of_instance = seen.instance_key != 0
    surface = 2 * seen.sights[:, Sight.SURFACE] > seen.missed
    gone = seen_through | (absent_group & unmatched & (of_instance | (judged & ~surface)))
    return np.asarray(gone, dtype=np.bool_)


def _groups(seen: LookedFor, settings: DiffSettings) -> NDArray[np.int64]:
    """Group number (N,): one per instance, one per neighbourhood cell of the background."""
    cells = np.floor(seen.position / settings.neighbourhood_m).astype(np.int64)
    keys = np.concatenate([seen.instance_key.astype(np.int64)[:, None], cells], axis=1)
    keys[seen.instance_key != 0, 1:] = 0
    return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1), dtype=np.int64)


def _absent_groups(
    group: NDArray[np.int64], judged: NDArray[np.bool_], unmatched: NDArray[np.bool_], settings: DiffSettings
) -> NDArray[np.bool_]:
    """Mask (N,) of the members of groups that were looked for and are missing as a whole."""
    n_judged = np.bincount(group, weights=judged)
    n_matched = np.bincount(group, weights=~unmatched)
    absent = (n_judged >= settings.min_group) & (n_matched <= settings.gone_match_ratio * n_judged)
    return np.asarray(absent[group], dtype=np.bool_)
