"""Which features of the stored map are gone rather than missed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.vehicle.diffing.visibility import Sight

_ENOUGH_JUDGED = 0.25
"""Share of an instance's features in view that must be judged before they speak for it as a whole."""


@dataclass(frozen=True)
class LookedFor:
    """What the frames of a window say about stored features, N rows sorted by id.

    Attributes:
        map_id: (N,) uint64, id in the stored map.
        position: (N, 3) float64, metres, map frame.
        instance_key: (N,) uint64, the instance that it belongs to; 0 for background.
        matched: (N,) float64, frames that matched it.
        sights: (N, 4) float64, frames by `Sight` in which it was predicted visible and not matched. Here and above a
            frame in which it could hardly have been found counts less than one.
    """

    map_id: NDArray[np.uint64]
    position: NDArray[np.float64]
    instance_key: NDArray[np.uint64]
    matched: NDArray[np.float64]
    sights: NDArray[np.float64]

    @classmethod
    def empty(cls) -> LookedFor:
        """Nothing was looked for."""
        return cls(
            np.zeros(0, np.uint64),
            np.zeros((0, 3)),
            np.zeros(0, np.uint64),
            np.zeros(0),
            np.zeros((0, len(Sight))),
        )

    @property
    def missed(self) -> NDArray[np.float64]:
        """Frames (N,) that should have seen it and did not; those where something hides it do not count."""
        return np.asarray(self.sights.sum(axis=1) - self.sights[:, Sight.HIDDEN])


def removed_features(seen: LookedFor, settings: DiffSettings) -> NDArray[np.bool_]:
    """Mask (N,) of the features that are gone.

    A single miss says little: corners flicker, and some are never found again. A feature is gone when it was looked
    for often enough, (nearly) never matched, and either stereo sees through where it stood in most of those frames,
    which several show together, or its neighbourhood - those of the same instance around it - is missing as a whole
    while the rest of the map matches. In the place of a missing vehicle a surface is another vehicle; in the
    background it is the old surface in other light. An instance most of which is gone has gone as a whole, and so has
    the part of it around a feature: the other part may be the next car.
    """
    looked_for = seen.matched + seen.missed
    judged = np.rint(looked_for) >= settings.min_visible_frames  # a frame may count less than one
    found = seen.matched > settings.gone_match_ratio * looked_for
    if not judged.any() or np.mean(found[judged]) < settings.min_match_ratio:
        return np.zeros(len(judged), np.bool_)
    missing = judged & ~found
    through = missing & (2 * seen.sights[:, Sight.THROUGH] > seen.missed)
    surface = 2 * seen.sights[:, Sight.SURFACE] > seen.missed
    absent = missing & _absent_neighbourhoods(seen, judged, settings) & ((seen.instance_key != 0) | ~surface)
    gone = absent | (through & _shared(through, judged, seen, settings))
    mostly = _mostly(gone, judged, seen.instance_key) | _mostly_around(gone, judged, seen, settings)
    return np.asarray(gone | (~found & mostly), dtype=np.bool_)


def _absent_neighbourhoods(seen: LookedFor, judged: NDArray[np.bool_], settings: DiffSettings) -> NDArray[np.bool_]:
    """Mask (N,) of the features whose neighbourhood was looked for and matched in hardly any frame."""
    group = _neighbourhoods(seen, settings)
    members = np.bincount(group, weights=judged)
    matched = np.bincount(group, weights=seen.matched * judged)
    missed = np.bincount(group, weights=seen.missed * judged)
    absent = (members >= settings.min_group) & (matched <= settings.gone_match_ratio * (matched + missed))
    return np.asarray(absent[group], dtype=np.bool_)


def _shared(
    gone: NDArray[np.bool_], judged: NDArray[np.bool_], seen: LookedFor, settings: DiffSettings
) -> NDArray[np.bool_]:
    """Mask (N,) of the features that seem gone along with others: half of those judged around them, or more.

    A single one that nobody finds again was a poor corner, or put down at a wrong depth: it harms nobody, and to tell
    of it takes bytes where nothing has changed.
    """
    group = _neighbourhoods(seen, settings)
    n_gone = np.bincount(group, weights=gone)
    shared = (n_gone >= 2) & (2 * n_gone >= np.bincount(group, weights=judged))
    return np.asarray(shared[group], dtype=np.bool_)


def _neighbourhoods(seen: LookedFor, settings: DiffSettings) -> NDArray[np.int64]:
    """Number (N,) of the cell and instance that each feature is in.

    Ids of cars in a dense row may have been mixed up, so an instance is not trusted to be one car.
    """
    cells = np.floor(seen.position[:, :2] / settings.neighbourhood_m).astype(np.int64)
    return _groups(seen.instance_key.astype(np.int64), *cells.T)


def _groups(*keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number (N,) of the group of equal keys (N,) that each row is in."""
    order = np.lexsort(keys)
    begins = np.zeros(len(order), np.bool_)
    for key in keys:
        begins[1:] |= np.diff(key[order]) != 0
    group = np.empty(len(order), np.int64)
    group[order] = np.cumsum(begins)
    return group


def _mostly(gone: NDArray[np.bool_], judged: NDArray[np.bool_], instance_key: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Mask (N,) of the features of instances most of whose judged features are gone.

    Where few of those in view were looked for often enough to be judged, the instance only just came into view: they
    do not speak for the others.
    """
    group = np.unique(instance_key, return_inverse=True)[1]
    n_judged = np.bincount(group, weights=judged)
    mostly = (2 * np.bincount(group, weights=gone) > n_judged) & (n_judged >= _ENOUGH_JUDGED * np.bincount(group))
    return np.asarray(mostly[group] & (instance_key != 0))


def _mostly_around(
    gone: NDArray[np.bool_], judged: NDArray[np.bool_], seen: LookedFor, settings: DiffSettings
) -> NDArray[np.bool_]:
    """Mask (N,) of the features most of whose judged neighbours of the same instance are gone."""
    mostly = np.zeros(len(gone), np.bool_)
    rows = np.flatnonzero(judged & (seen.instance_key != 0))
    if not gone[rows].any():
        return mostly
    pairs = rows[cKDTree(seen.position[rows]).query_pairs(settings.neighbourhood_m, output_type="ndarray")]
    pairs = pairs[seen.instance_key[pairs[:, 0]] == seen.instance_key[pairs[:, 1]]]
    row, neighbour = np.concatenate([pairs, pairs[:, ::-1]]).T
    n_gone = np.bincount(row, weights=gone[neighbour], minlength=len(gone))
    n = np.bincount(row, minlength=len(gone))
    mostly[:] = (n >= settings.min_group - 1) & (2 * n_gone > n)
    return mostly
