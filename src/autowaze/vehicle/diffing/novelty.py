"""Which landmarks of the drive are news to the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.world.identity import MAX_FEATURES_PER_DIFF
from autowaze.world.labels import ClassLabel, is_movable, is_vehicle

_SIGMAS = 3.0
_KNOWN_FRACTION = 0.5
"""An instance of which this share lies on stored vehicle features is the stored one."""
_BYTES_PER_DESCRIBED, _BYTES_PER_PLAIN = 43, 6  # on the wire, after compression, seen on real streets
_NEVER_MAPPED = (ClassLabel.PERSON, ClassLabel.ANIMAL)


@dataclass
class Candidates:
    """Landmarks without a match in the map that the window found, N rows.

    Attributes:
        landmark_id: (N,) int64.
        position: (N, 3) float64, metres, map frame.
        label: (N,) uint8, majority over the window; instance: (N,) int64 likewise, 0 for none.
        found: (N,) int64, frames that matched it.
        wanted: (N,) int64, those of them that found too little of the stored map.
        depth_sigma_m: (N,) float64, of its nearest observation.
        position_sigma_m: (N,) float64, of its position where it is known worst, by all views of it together.
        offset_px: (N,) float64, how far off such an error makes it appear in the next lane.
        deviation_m: (N,) float64, how far its position lies from where that observation saw it.
    """

    landmark_id: NDArray[np.int64]
    position: NDArray[np.float64]
    label: NDArray[np.uint8]
    instance: NDArray[np.int64]
    found: NDArray[np.int64]
    wanted: NDArray[np.int64]
    depth_sigma_m: NDArray[np.float64]
    position_sigma_m: NDArray[np.float64]
    offset_px: NDArray[np.float64]
    deviation_m: NDArray[np.float64]


def new_features(
    candidates: Candidates,
    moving_instances: NDArray[np.int64],
    stored_vehicles: NDArray[np.float64],
    stored_static: NDArray[np.float64],
    settings: DiffSettings,
    byte_budget: int,
) -> NDArray[np.int64]:
    """Row numbers of the candidates worth sending, as many as a diff holds: static ones, then those by instance, for
    which the former make room.

    Args:
        candidates: landmarks that the map lacks.
        moving_instances: ids of instances that move; their features are traffic, not map.
        stored_vehicles: (M, 3) positions of the map's vehicle features that are still there.
        stored_static: (S, 3) positions of its other features that are: where it has some, more of them are no news.
        settings: thresholds.
        byte_budget: what the features may take on the wire.
    """
    movable = is_movable(candidates.label)
    depth_is_certain = candidates.depth_sigma_m <= settings.max_depth_sigma_m
    place_is_certain = candidates.position_sigma_m <= settings.max_depth_sigma_m
    place_is_certain |= candidates.offset_px <= settings.max_offset_px
    eligible = (
        np.where(
            movable, candidates.found >= settings.min_found_vehicle, candidates.wanted >= settings.min_found_static
        )
        & np.where(movable, depth_is_certain, place_is_certain)
        & (candidates.deviation_m <= _SIGMAS * candidates.depth_sigma_m + settings.max_depth_sigma_m)
        & ~np.isin(candidates.instance, moving_instances[moving_instances != 0])
        & ~np.isin(candidates.label, _NEVER_MAPPED)
    )
    eligible &= ~_known_instances(candidates, eligible, stored_vehicles, settings)
    instanced = _best_per_instance(candidates, np.flatnonzero(eligible & movable), settings.max_per_instance)
    room = (byte_budget - _BYTES_PER_PLAIN * len(instanced)) // _BYTES_PER_DESCRIBED
    limit = max(min(settings.max_new_static, room, MAX_FEATURES_PER_DIFF - len(instanced)), 0)
    news = ~any_within(stored_static, candidates.position, settings.spread_m)
    static = _best_spread(candidates, np.flatnonzero(eligible & ~movable & news), limit, settings.spread_m)
    return np.concatenate([static, instanced])[:MAX_FEATURES_PER_DIFF]


def _known_instances(
    candidates: Candidates, eligible: NDArray[np.bool_], stored: NDArray[np.float64], settings: DiffSettings
) -> NDArray[np.bool_]:
    """Mask (N,) of the vehicle features whose instance the map holds already."""
    known = np.zeros(len(eligible), np.bool_)
    vehicle = eligible & is_vehicle(candidates.label)
    if not len(stored) or not vehicle.any():
        return known
    explained = any_within(stored, candidates.position[vehicle], settings.known_radius_m)
    _, group = np.unique(candidates.instance[vehicle], return_inverse=True)
    share = np.bincount(group, weights=explained) / np.bincount(group)
    known[vehicle] = share[group] >= _KNOWN_FRACTION
    return known


def _best_spread(candidates: Candidates, rows: NDArray[np.int64], limit: int, spread_m: float) -> NDArray[np.int64]:
    """At most `limit` rows: the best-seen of each cell, then the second-best, and so on."""
    cell = np.floor(candidates.position[rows] / spread_m).astype(np.int64)
    order = np.lexsort((candidates.landmark_id[rows], -candidates.found[rows], cell[:, 2], cell[:, 1], cell[:, 0]))
    rows, cell = rows[order], cell[order]
    if len(rows) <= limit:
        return rows
    starts = np.r_[True, (np.diff(cell, axis=0) != 0).any(axis=1)]
    rank = np.arange(len(rows)) - np.maximum.accumulate(np.where(starts, np.arange(len(rows)), 0))
    best = np.lexsort((candidates.landmark_id[rows], -candidates.found[rows], rank))[:limit]
    return rows[np.sort(best)]


def _best_per_instance(candidates: Candidates, rows: NDArray[np.int64], limit: int) -> NDArray[np.int64]:
    """At most `limit` best-seen rows of each instance, sorted by instance."""
    instance = candidates.instance[rows]
    order = np.lexsort((candidates.landmark_id[rows], -candidates.found[rows], instance))
    rows, instance = rows[order], instance[order]
    starts = np.r_[True, np.diff(instance) != 0] if len(rows) else np.zeros(0, np.bool_)
    rank = np.arange(len(rows)) - np.maximum.accumulate(np.where(starts, np.arange(len(rows)), 0))
    return np.asarray(rows[(rank < limit) | (instance == 0)], dtype=np.int64)


def any_within(points: NDArray[np.float64], places: NDArray[np.float64], radius_m: float) -> NDArray[np.bool_]:
    """Mask (N,) of the places (N, 3) with a point (M, 3) within the radius."""
    if not len(points) or not len(places):
        return np.zeros(len(places), np.bool_)
    return np.asarray(np.isfinite(cKDTree(points).query(places, distance_upper_bound=radius_m)[0]))
