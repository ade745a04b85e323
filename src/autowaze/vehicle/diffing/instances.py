"""What a window saw of each instance: from where, how surely, and whether it moved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.motion import Motions
from autowaze.world.identity import MAX_INSTANCE
from autowaze.world.instances import Tracks
from autowaze.world.map_diff import InstanceSummaries, Traffic
from autowaze.world.pose import Pose


class InstanceRecord:
    """Rows of (frame, instance) over a window."""

    def __init__(self, session: int) -> None:
        self.session = session
        self._track_rows: list[NDArray[np.float64]] = []
        self._motion_rows: list[NDArray[np.float64]] = []

    def add(self, tracks: Tracks, motions: Motions, T_map_cam: Pose) -> None:
        """Note the instances of one frame."""
        self._track_rows.append(np.column_stack([tracks.id, tracks.label, tracks.confidence]).astype(np.float64))
        view = motions.position.astype(np.float64) - T_map_cam[:2, 3]
        view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-6)
        self._motion_rows.append(
            np.column_stack([motions.id, motions.label, motions.moving, motions.position, motions.velocity, view])
        )

    def moving_ids(self) -> NDArray[np.int64]:
        """Instances (N,) that moved in most of the frames that saw them, or at the end."""
        rows = _stack(self._motion_rows, 9)
        ids, group = np.unique(rows[:, 0].astype(np.int64), return_inverse=True)
        n = np.bincount(group, minlength=len(ids))
        moving = np.bincount(group, weights=rows[:, 2], minlength=len(ids))
        last = np.zeros(len(ids))
        last[group] = rows[:, 2]  # the rows are in the order of time
        return ids[(2 * moving > n) | (last > 0)]

    def summaries(self, keys: NDArray[np.uint64]) -> InstanceSummaries:
        """The instances of these keys."""
        wanted = (keys[keys != 0] & np.uint64(MAX_INSTANCE - 1)).astype(np.int64)
        seen, motion = _stack(self._track_rows, 3), _stack(self._motion_rows, 9)
        seen = seen[np.isin(seen[:, 0], wanted)]
        ids, group = np.unique(seen[:, 0].astype(np.int64), return_inverse=True)
        frames = np.bincount(group, minlength=len(ids))
        confidence = np.bincount(group, weights=seen[:, 2], minlength=len(ids)) / np.maximum(frames, 1)
        votes = np.zeros((len(ids), 16))
        np.add.at(votes, (group, seen[:, 1].astype(np.int64)), seen[:, 2])
        view = np.zeros((len(ids), 2))
        of_wanted = np.isin(motion[:, 0], ids)
        np.add.at(view, np.searchsorted(ids, motion[of_wanted, 0]), motion[of_wanted, 7:9])
        view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-6)
        return InstanceSummaries(
            id=ids.astype(np.int32),
            label=votes.argmax(axis=1).astype(np.uint8),
            confidence=confidence.astype(np.float32),
            view_direction=view.astype(np.float32),
            frames=np.minimum(frames, 0xFFFF).astype(np.uint16),
        )

    def traffic(self) -> Traffic:
        """The moving instances as last seen moving."""
        rows = _stack(self._motion_rows, 9)
        rows = rows[(rows[:, 2] > 0) & np.isin(rows[:, 0], self.moving_ids())]
        ids, last_from_end = np.unique(rows[::-1, 0].astype(np.int64), return_index=True)
        last = rows[::-1][last_from_end]
        return Traffic(
            id=ids.astype(np.int32),
            label=last[:, 1].astype(np.uint8),
            position=last[:, 3:5].astype(np.float32),
            velocity=last[:, 5:7].astype(np.float32),
        )


def _stack(rows: list[NDArray[np.float64]], columns: int) -> NDArray[np.float64]:
    return np.concatenate(rows) if rows else np.zeros((0, columns))
