"""Whether a car can have seen what it says: where it was, how fast it went, how far it looked.

Each check needs only the diff and where the service has its spots. Limits are such that no car on a road meets them:
they shall stop lies, not odd drives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from autowaze.cloud.cell_kernels import blocks_of_cells
from autowaze.cloud.diff_kernels import PathFacts, all_between, most_frames, path_facts
from autowaze.cloud.path_distance import all_within
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.georeference import Georeference
from autowaze.world.ground import CELL_M
from autowaze.world.labels import is_movable
from autowaze.world.map_diff import SemanticMapDiff

LOOKED_UP_AT_ONCE = 1 << 18
"""Pairs of a point and a piece of the path that are compared one by one; a tree is quicker for more."""
CLOCK_TOLERANCE_S = 1.0
_NOWHERE = np.zeros(4)


@dataclass(frozen=True)
class Limits:
    """What no honest car exceeds.

    Attributes:
        most_window_s: length of a window; cars use 5 s.
        most_frames_per_s: of a camera.
        most_speed_mps: of a car, 250 km/h.
        most_jump_m: how far a position may be set right at once: visual odometry through a tunnel of 5 km is off by
            1 to 2 % of it when the map or the sky is seen again.
        feature_sight_m: a feature of what may be elsewhere tomorrow is told when its depth is certain to 0.35 m; with z
            = sqrt(sigma_z f b / sigma_d) a rig of f = 2000 px and b = 1 m that matches to 0.15 px sees so far as 68 m.
        removal_sight_m: what is missing of such things is noticed somewhat farther away.
        landmark_sight_m: what stands is told from wherever a car in the next lane would see it where it is foretold:
            towers and roofs at the end of a street; a rig of b = 1 m begins with it 720 m away. No spot hangs on it.
        ground_sight_m: ground is looked at up to 25 m ahead, and as far to the sides.
        most_height_m: above or below the path; `landmark_height_m` of what stands: 22 degrees upwards at the farthest.
        most_found_per_frame: new features that one frame can bear witness of; 2000 are extracted.
        most_sigma_m: a car that knows its place no better cannot say what stands where.
        area_margin_m: how far from the nearest edge of the parking map a car's reports are of use.
    """

    most_window_s: float = 120.0
    most_frames_per_s: float = 240.0
    most_speed_mps: float = 70.0
    most_jump_m: float = 150.0
    feature_sight_m: float = 80.0
    removal_sight_m: float = 120.0
    landmark_sight_m: float = 1000.0
    ground_sight_m: float = 50.0
    most_height_m: float = 100.0
    landmark_height_m: float = 400.0
    most_found_per_frame: int = 2000
    most_sigma_m: float = 25.0
    area_margin_m: float = 20_000.0


def check_plausible(
    diff: SemanticMapDiff,
    bounds: NDArray[np.float64] | None = None,
    georeference: Georeference | None = None,
    limits: Limits | None = None,
) -> None:
    """Refuse a checked diff that no car can have made.

    Args:
        diff: passed `validation.check_diff`.
        bounds: (4,) x0, y0, x1, y1 of the parking map in map metres.
        georeference: of the service.
        limits: what a car can do.

    Raises:
        RefusedDiffError: naming what cannot be, with `reason` of its kind.
    """
    limits = limits or Limits()
    _check_window(diff, limits)
    if len(diff.trajectory) == 0:
        says = len(diff.new) + len(diff.removed) + len(diff.ground) + len(diff.instances) + len(diff.traffic)
        _require(says == 0, "no_path", "it tells what was seen, but not from where")
        return
    _require(georeference is None or diff.georeference is not None, "no_path", "it names no georeference")
    path = PathFacts(
        *path_facts(diff.trajectory.time, diff.trajectory.position, _NOWHERE if bounds is None else bounds)
    )
    _check_path(diff, path, limits)
    _require(
        bounds is None or path.outside_m <= limits.area_margin_m,
        "outside",
        f"its path is {path.outside_m / 1000:.0f} km from the spots of this service",
    )
    _check_counts(diff, limits)
    _check_sight(diff, path, limits)


def check_removed(
    diff: SemanticMapDiff, position: NDArray[np.float64], label: NDArray[np.uint8], limits: Limits | None = None
) -> None:
    """Refuse a diff that removes features (R, 3) of the map, with these labels (R,), from where they cannot be seen.

    Raises:
        RefusedDiffError: they are too far from its path.
    """
    limits = limits or Limits()
    stands = ~is_movable(label)
    _within(diff, position[~stands], limits.removal_sight_m, "a removed feature")
    _within(diff, position[stands], limits.landmark_sight_m, "a removed landmark")


def _check_window(diff: SemanticMapDiff, limits: Limits) -> None:
    length_s = diff.end - diff.start
    _require(length_s <= limits.most_window_s, "too_long", f"its window lasts {length_s:.0f} s")
    frames = limits.most_frames_per_s * length_s + 2
    _require(diff.frames <= frames, "too_many_frames", f"{diff.frames} frames in {length_s:.1f} s")
    _require(diff.position_sigma_m <= limits.most_sigma_m, "unsure", f"position known to {diff.position_sigma_m:.0f} m")


def _check_path(diff: SemanticMapDiff, path: PathFacts, limits: Limits) -> None:
    early, late = path.begin - diff.start, path.end - diff.end
    in_time = early >= -CLOCK_TOLERANCE_S and late <= CLOCK_TOLERANCE_S
    _require(in_time and path.in_order, "path_out_of_time", "its path is not of its window")
    most_m = limits.most_speed_mps * (diff.end - diff.start) + limits.most_jump_m
    took = f"a path of {path.length_m:.0f} m in {diff.end - diff.start:.1f} s"
    _require(path.length_m <= most_m, "too_fast", took)


def _check_counts(diff: SemanticMapDiff, limits: Limits) -> None:
    frames, new, ground = diff.frames, diff.new, diff.ground
    _require(
        len(new) <= limits.most_found_per_frame * max(frames - 1, 0),  # a feature is seen in two frames at least
        "too_many_features",
        f"{len(new)} new features from {frames} frames",
    )
    most_seen = most_frames(new.observations, ground.free, ground.obstacle, diff.instances.frames)
    _require(most_seen <= frames, "too_many_features", f"something was seen in {most_seen} frames of {frames}")
    since, until = diff.start - CLOCK_TOLERANCE_S, diff.end + CLOCK_TOLERANCE_S
    in_time = all_between(new.first_seen, since, until) and all_between(new.last_seen, since, until)
    _require(in_time, "back_dated", "a new feature was not seen within the window")


def _check_sight(diff: SemanticMapDiff, path: PathFacts, limits: Limits) -> None:
    stands = ~is_movable(diff.new.label)
    for position, height_m, sight_m, what in (
        (diff.new.position[~stands], limits.most_height_m, limits.feature_sight_m, "a new feature"),
        (diff.new.position[stands], limits.landmark_height_m, limits.landmark_sight_m, "a new landmark"),
    ):
        in_height = all_between(position[:, 2], path.lowest_m - height_m, path.highest_m + height_m)
        _require(in_height, "too_far", f"{what} is {height_m:.0f} m up or down")
        _within(diff, position, sight_m, what)
    blocks = blocks_of_cells(diff.ground.ix, diff.ground.iy, _BLOCK_BITS)
    centres = np.asarray((blocks + 0.5) * _BLOCK_M, dtype=np.float64)
    _within(diff, centres, limits.ground_sight_m + _BLOCK_M * 0.71, "a ground cell")


_BLOCK_BITS = 4
_BLOCK_M = CELL_M * (1 << _BLOCK_BITS)


def _within(diff: SemanticMapDiff, points: NDArray[np.float64], sight_m: float, what: str) -> None:
    """Refuse a diff one of whose points (N, 2) or (N, 3) lies farther from its path than that."""
    if len(points) == 0:
        return
    _require(
        _all_near(points, diff.trajectory.position, sight_m),
        "too_far",
        f"{what} is more than {sight_m:.0f} m from its path",
    )


def _all_near(points: NDArray[np.float64], path: NDArray[np.float64], within_m: float) -> bool:
    """Whether each point (N, 2) or (N, 3) is so near, over the ground, to the polyline through path (M, 3)."""
    if len(points) * len(path) <= LOOKED_UP_AT_ONCE:
        return bool(all_within(points, path, within_m))
    points, path = points[:, :2], path[:, :2]
    low, high = path.min(axis=0) - within_m, path.max(axis=0) + within_m
    if not ((points >= low) & (points <= high)).all():
        return False
    starts, steps = path[:-1] if len(path) > 1 else path, np.diff(path, axis=0) if len(path) > 1 else path * 0.0
    spacing_m = within_m / 10
    pieces = np.maximum(np.ceil(np.hypot(*steps.T) / spacing_m), 1).astype(np.int64)
    row = np.repeat(np.arange(len(pieces)), pieces)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[row]
    dense = np.vstack([starts[row] + share[:, None] * steps[row], path[-1:]])
    distance, _ = cKDTree(dense).query(points, distance_upper_bound=within_m + spacing_m)
    return bool(np.isfinite(distance).all())


def _require(holds: bool, reason: str, complaint: str) -> None:
    if not holds:
        raise RefusedDiffError(complaint, reason)
