"""What the cars say of the instances that they saw, summed up over windows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from autowaze.cloud.path_distance import away_from
from autowaze.world.columns import Columns
from autowaze.world.identity import MAX_INSTANCE
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import SemanticMapDiff, Trajectory

SIGHT_M = 30.0
"""How far ahead cars see vehicles well enough to tell of them."""
BEND_RADIUS_M = 60.0
"""How tightly a street may bend where nobody has driven yet (one sigma)."""


@dataclass
class InstanceViews(Columns):
    """Instances as seen over all windows, N rows.

    Attributes:
        key: (N,) uint64, `world.identity.instance_keys`.
        label: (N,) uint8, the `ClassLabel` that most frames gave it; background where no window told.
        confidence: (N,) float64, mean over the frames.
        view_direction: (N, 2) float64, horizontal vector, map frame, at most of length 1, against which its visible
            side faces: from the camera to it on average, and across from the street; zero where no window told.
        frames: (N,) int64.
        seen_at: (N,) float64, end of the last window that it was seen in, seconds since the epoch; 0 where none told.
    """

    key: NDArray[np.uint64]
    label: NDArray[np.uint8]
    confidence: NDArray[np.float64]
    view_direction: NDArray[np.float64]
    frames: NDArray[np.int64]
    seen_at: NDArray[np.float64]


_Summary = tuple[int, float, float, float, int, float]
"""label, confidence, view x, view y, frames, end of the window."""


class InstanceTable:
    """Summaries by instance key and window; asked in any order of arrival it answers the same."""

    def __init__(self) -> None:
        self._windows: dict[int, dict[int, _Summary]] = {}

    def __len__(self) -> int:
        return len(self._windows)

    def add(self, keys: NDArray[np.uint64], diff: SemanticMapDiff) -> None:
        """Note the instances of one diff; keys (N,) are those of `diff.instances`."""
        rows, view = diff.instances, _views_of(diff)
        columns = (rows.label, rows.confidence, view[:, 0], view[:, 1], rows.frames)
        values = zip(keys.tolist(), *(column.tolist() for column in columns), strict=True)
        for key, label, confidence, view_x, view_y, frames in values:
            window = (label, confidence, view_x, view_y, frames, diff.end)
            self._windows.setdefault(key, {})[diff.sequence] = window

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot."""
        return {"windows": {key: dict(windows) for key, windows in self._windows.items()}}

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""
        self._windows = {
            key: {sequence: tuple(summary) for sequence, summary in windows.items()}
            for key, windows in kept["windows"].items()
        }

    def forget(self, key: int) -> None:
        """Drop what windows told of an instance."""
        self._windows.pop(key, None)

    def views(self, keys: NDArray[np.uint64]) -> InstanceViews:
        """Rows for these keys, in their order."""
        rows = [_summed_up(self._windows.get(key, {})) for key in keys.tolist()]
        table = np.array(rows, dtype=np.float64).reshape(-1, 6)
        return InstanceViews(
            key=keys,
            label=table[:, 0].astype(np.uint8),
            confidence=table[:, 1],
            view_direction=table[:, 2:4],
            frames=table[:, 4].astype(np.int64),
            seen_at=table[:, 5],
        )


def _views_of(diff: SemanticMapDiff) -> NDArray[np.float64]:
    """Against which directions (N, 2) the visible sides of a diff's instances face.

    Cars in bays are seen along the street, askew to none of their ends: what shows of them, between their neighbours,
    is the end at the street. So the way across the street to an instance counts as much as the mean view of it.
    """
    view = diff.instances.view_direction.astype(np.float64)
    owner = (diff.new.instance_key & np.uint64(MAX_INSTANCE - 1)).astype(np.int64)
    ids, row = np.unique(np.concatenate([diff.instances.id, owner]), return_inverse=True)
    own = row[: len(view)]
    points = np.bincount(row[len(view) :], minlength=len(ids))[own]
    told = points > 0
    if len(diff.trajectory) == 0 or not told.any():
        return view
    sums = [np.bincount(row[len(view) :], diff.new.position[:, axis], len(ids))[own[told]] for axis in (0, 1)]
    middle = np.stack(sums, axis=1) / points[told, None]
    across = away_from(middle, _path_ahead(diff.trajectory))
    view[told] += _certain_side(middle, diff.trajectory)[:, None] * across
    return np.asarray(view / np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1.0))


def _certain_side(points: NDArray[np.float64], trajectory: Trajectory) -> NDArray[np.float64]:
    """How certain it is (N,), 0 to 1, on which side of the street points (N, 2) lie.

    It is of what the car has passed. Ahead of it the street may bend, by more than a parked car stands off the straight
    line: the chance of the one side less that of the other.
    """
    heading = float(trajectory.heading[-1])
    ahead = np.array([np.sin(heading), np.cos(heading)])
    off = points - trajectory.position[-1, :2]
    bends_m = np.maximum(off @ ahead, 0.0) ** 2 / (2.0 * BEND_RADIUS_M)
    aside_m = np.abs(off @ np.array([ahead[1], -ahead[0]]))
    return np.asarray(erf(aside_m / np.maximum(np.sqrt(2.0) * bends_m, 1e-6)), dtype=np.float64)


def _path_ahead(trajectory: Trajectory) -> NDArray[np.float64]:
    """The path (M, 2) of a window and, straight on, the street that the car sees at its end."""
    heading = float(trajectory.heading[-1])
    end = trajectory.position[-1, :2] + SIGHT_M * np.array([np.sin(heading), np.cos(heading)])
    return np.vstack([trajectory.position[:, :2], end])


def _summed_up(windows: dict[int, _Summary]) -> _Summary:
    """Mean over the frames of all windows, in the order of the windows so that sums come out the same bit for bit."""
    frames, confidence, view_x, view_y, seen_at = 0, 0.0, 0.0, 0.0, 0.0
    votes: dict[int, int] = {}
    for sequence in sorted(windows):
        label, c, x, y, n, end = windows[sequence]
        n = max(n, 1)
        frames += n
        confidence, view_x, view_y = confidence + c * n, view_x + x * n, view_y + y * n
        votes[label] = votes.get(label, 0) + n
        seen_at = max(seen_at, end)
    if not frames:
        return int(ClassLabel.BACKGROUND), 0.0, 0.0, 0.0, 0, 0.0
    label = max(sorted(votes), key=lambda candidate: votes[candidate])
    return label, confidence / frames, view_x / frames, view_y / frames, frames, seen_at
