"""Which landmarks of the drive are news to the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from autowaze.vehicle.diffing.settings import DiffSettings
from autowaze.world.identity import MAX_FEATURES_PER_DIFF
from autowaze.world.labels import ClassLabel, is_movable, is_vehicle

_SIGMAS = 3.0
_KNOWN_FRACTION = 0.45
"""An instance of which this share lies on stored vehicle features is the stored one. Where nothing had changed it was
0.49 or more, of most vehicles 0.8; where others stood in all spots 0.32 or less, but for two alike to centimetres."""
_SAME_SIGMAS = 2.0
_ENOUGH_TO_REPLACE = 10  # features
_BYTES_PER_DESCRIBED, _BYTES_PER_PLAIN = 43, 6  # on the wire, after compression, seen on real streets
_NEAR_PATH_M = 60.0
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
        position_sigma_m: (N,) float64, of its position where it is known worst, by all views of it together; infinite
            for those that were not found often enough to be sent.
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
    stored_movable: NDArray[np.float64],
    stored_static: NDArray[np.float64],
    settings: DiffSettings,
    byte_budget: int,
) -> NDArray[np.int64]:
    """Row numbers of the candidates worth sending, as many as a diff holds: static ones, then those by instance, for
    which the former make room.

    Args:
        candidates: landmarks that the map lacks.
        moving_instances: ids of instances that move; their features are traffic, not map.
        stored_movable: (M, 3) positions of the map's features of what comes and goes, as far as they are still there.
        stored_static: (S, 3) positions of its other features that are: where it has some, more of them are no news.
        settings: thresholds.
        byte_budget: what the features may take on the wire.
    """
    movable = is_movable(candidates.label)
    depth_is_certain = candidates.depth_sigma_m <= settings.max_depth_sigma_m
    place_is_certain = candidates.position_sigma_m <= settings.max_depth_sigma_m
    place_is_certain |= candidates.offset_px <= settings.max_offset_px
    eligible = (
        found_often_enough(candidates.label, candidates.found, candidates.wanted, settings)
        & np.where(movable, depth_is_certain, place_is_certain)
        & (candidates.deviation_m <= _SIGMAS * candidates.depth_sigma_m + settings.max_depth_sigma_m)
        & ~np.isin(candidates.instance, moving_instances[moving_instances != 0])
        & ~np.isin(candidates.label, _NEVER_MAPPED)
    )
    eligible &= ~_known_instances(candidates, eligible, stored_movable, settings)
    eligible &= ~_hardly_seen_instances(candidates, eligible, settings)
    instanced = _best_per_instance(candidates, np.flatnonzero(eligible & movable), settings)
    room = (byte_budget - _BYTES_PER_PLAIN * len(instanced)) // _BYTES_PER_DESCRIBED
    limit = max(min(settings.max_new_static, room, MAX_FEATURES_PER_DIFF - len(instanced)), 0)
    standing = np.flatnonzero(eligible & ~movable)
    standing = standing[~any_within(stored_static, candidates.position[standing], settings.spread_m)]
    static = _best_spread(candidates, standing, limit, settings.spread_m)
    return np.concatenate([static, instanced])[:MAX_FEATURES_PER_DIFF]


def found_often_enough(
    label: NDArray[np.uint8], found: NDArray[np.int64], wanted: NDArray[np.int64], settings: DiffSettings
) -> NDArray[np.bool_]:
    """Mask (N,) of the landmarks, with columns as of `Candidates`, that enough frames found or wanted."""
    often = np.where(is_movable(label), found >= settings.min_found_vehicle, wanted >= settings.min_found_static)
    return np.asarray(often)


def replaced_features(
    candidates: Candidates,
    told: NDArray[np.int64],
    stored_movable: NDArray[np.float64],
    stored_instance: NDArray[np.uint64],
    settings: DiffSettings,
) -> NDArray[np.bool_]:
    """Mask (M,) of the map's features of vehicles and bicycles in whose place another vehicle stands: two take no
    room together.

    Args:
        candidates: as in `new_features`; told: the rows that are sent.
        stored_movable: (M, 3) positions of the map's features of what comes and goes; stored_instance: (M,) keys of
            their instances.
        settings: thresholds.
    """
    instances, count = np.unique(candidates.instance[told[is_vehicle(candidates.label[told])]], return_counts=True)
    instances = instances[(instances != 0) & (count >= _ENOUGH_TO_REPLACE)]
    if not len(instances) or not len(stored_movable):
        return np.zeros(len(stored_movable), np.bool_)
    certain = is_vehicle(candidates.label) & (candidates.depth_sigma_m <= settings.max_depth_sigma_m)
    is_new = np.isin(candidates.instance, instances)
    to_new = _distances(candidates.position[certain & is_new], stored_movable)
    to_known = _distances(candidates.position[certain & ~is_new], stored_movable)
    taken = (to_new <= settings.known_radius_m) & (to_new < to_known)
    group = np.unique(stored_instance, return_inverse=True)[1]
    mostly = 2 * np.bincount(group, weights=taken) > np.bincount(group)
    return np.asarray(taken | (mostly[group] & (stored_instance != 0)))


def _known_instances(
    candidates: Candidates, eligible: NDArray[np.bool_], stored: NDArray[np.float64], settings: DiffSettings
) -> NDArray[np.bool_]:
    """Mask (N,) of the movable features whose instance the map holds already: most lie where it has movable ones.

    Corners of one vehicle are found again within centimetres, by another camera and in other light, too; those of
    another vehicle in its place lie near them by chance only. Half a car that a network takes for a motorcycle is
    still that car.
    """
    known = np.zeros(len(eligible), np.bool_)
    movable = eligible & is_movable(candidates.label)
    if not len(stored) or not movable.any():
        return known
    radius = np.hypot(settings.same_radius_m, _SAME_SIGMAS * candidates.position_sigma_m[movable])
    explained = _distances(stored, candidates.position[movable]) <= radius
    _, group = np.unique(candidates.instance[movable], return_inverse=True)
    share = np.bincount(group, weights=explained) / np.bincount(group)
    known[movable] = share[group] >= _KNOWN_FRACTION
    return known


def _hardly_seen_instances(
    candidates: Candidates, eligible: NDArray[np.bool_], settings: DiffSettings
) -> NDArray[np.bool_]:
    """Mask (N,) of the movable features of instances that have too few to say where a vehicle or bicycle stands."""
    movable = np.flatnonzero(eligible & is_movable(candidates.label) & (candidates.instance != 0))
    few = np.zeros(len(eligible), np.bool_)
    _, group, count = np.unique(candidates.instance[movable], return_inverse=True, return_counts=True)
    few[movable] = (count < settings.min_group)[group]
    return few


def _best_spread(candidates: Candidates, rows: NDArray[np.int64], limit: int, spread_m: float) -> NDArray[np.int64]:
    """At most `limit` rows: the best-seen of each cell, then the second-best, and so on."""
    rows, rank = _ranked_in_cells(candidates, rows, np.zeros(len(rows), np.int64), spread_m)
    if len(rows) <= limit:
        return rows
    best = np.lexsort((candidates.landmark_id[rows], -candidates.found[rows], rank))[:limit]
    return rows[np.sort(best)]


def _best_per_instance(candidates: Candidates, rows: NDArray[np.int64], settings: DiffSettings) -> NDArray[np.int64]:
    """The best-seen rows of each instance, as many as it may have, spread over what was seen of it."""
    rows, rank = _ranked_in_cells(candidates, rows, candidates.instance[rows], settings.spread_on_vehicle_m)
    instance = candidates.instance[rows]
    order = np.lexsort((candidates.landmark_id[rows], -candidates.found[rows], rank, instance))
    rows, instance = rows[order], instance[order]
    return np.asarray(rows[(_rank_in_runs(instance) < settings.max_per_instance) | (instance == 0)], dtype=np.int64)


def _ranked_in_cells(
    candidates: Candidates, rows: NDArray[np.int64], group: NDArray[np.int64], edge_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows by group (N,) and cubic cell, the best-seen of each first, and how many come before each in its cell."""
    cell = np.floor(candidates.position[rows] / edge_m).astype(np.int64)
    cell -= cell.min(axis=0, initial=0)
    x, y, z = (cell * np.append(np.cumprod((cell.max(axis=0, initial=0) + 1)[:0:-1])[::-1], 1)).T
    number = x + y + z
    order = np.lexsort((candidates.landmark_id[rows], -candidates.found[rows], number, group))
    return rows[order], _rank_in_runs(group[order], number[order])


def _rank_in_runs(*keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many rows (N,) before each are of the same run of equal keys (N,)."""
    row = np.arange(len(keys[0]))
    starts = np.zeros(len(row), np.bool_)
    starts[:1] = True
    for key in keys:
        starts[1:] |= np.diff(key) != 0
    return np.asarray(row - np.maximum.accumulate(np.where(starts, row, 0)))


def any_within(points: NDArray[np.float64], places: NDArray[np.float64], radius_m: float) -> NDArray[np.bool_]:
    """Mask (N,) of the places (N, 3) with a point (M, 3) within the radius."""
    return _distances(points, places, radius_m) <= radius_m


def _distances(
    points: NDArray[np.float64], places: NDArray[np.float64], at_most_m: float = np.inf
) -> NDArray[np.float64]:
    """How far (N,) it is from each place (N, 3) to the nearest point (M, 3); infinity beyond `at_most_m`."""
    if not len(points) or not len(places):
        return np.full(len(places), np.inf)
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)  # asked once: most of the time goes into making it
    return np.asarray(tree.query(places, distance_upper_bound=at_most_m)[0])


def near_path(position: NDArray[np.floating], path: Sequence[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Which of the positions (N, 3) a window that came along a path of (3,) may have come near."""
    if not path:
        return np.zeros(len(position), np.bool_)
    places = np.array(path)[:, :2]
    low, high = places.min(axis=0) - _NEAR_PATH_M, places.max(axis=0) + _NEAR_PATH_M
    return np.asarray(((position[:, :2] > low) & (position[:, :2] < high)).all(axis=1))
