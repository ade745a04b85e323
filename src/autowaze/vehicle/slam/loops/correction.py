"""Where the car was at each frame, as the drive is known after its loops were closed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from autowaze.vehicle.slam.loops.closer import LoopCloser
from autowaze.vehicle.slam.small_matrices import then
from autowaze.world.pose import inverse, make_pose


class DriveCorrection:
    """What takes the map around the car as it was told, frame by frame, to the map as it is known after the drive.

    At a place k the motion is C_k = T_k T_k,told^-1. A frame between two places is moved by both, each counting by how
    near it is in frames; before the first and after the last place by the one alone. A jump that closing a loop made
    in the told poses is taken back first.

    Args:
        loops: of the drive, finished.
        T_told: (N, 4, 4) poses as tracking told them, of all its frames.
    """

    def __init__(self, loops: LoopCloser, T_told: NDArray[np.float64]) -> None:
        at = np.array([place.index - 1 for place in loops.places], np.int64)
        self._jump = _jumps(loops.corrections, len(T_told))
        smooth = inverse(self._jump) @ T_told
        adjusted = np.stack([place.T_map_cam for place in loops.places]) if len(at) else np.zeros((0, 4, 4))
        self._motion = adjusted @ inverse(smooth[at])
        self._at = at
        self._smooth = smooth

    def poses(self) -> NDArray[np.float64]:
        """Poses (N, 4, 4) of all frames as they are known after the drive."""
        frames = np.arange(len(self._smooth))
        if not len(self._at):
            return self._smooth
        moved = np.empty_like(self._smooth)
        before, after, share = self._around(frames)
        moved[:] = self._smooth
        moved[:, :3, 3] = self._blended(before, after, share, self._smooth[:, :3, 3])
        turn = self._motion[before, :3, :3].swapaxes(1, 2) @ self._motion[after, :3, :3]
        part = Rotation.from_rotvec(share[:, None] * Rotation.from_matrix(turn).as_rotvec()).as_matrix()
        moved[:, :3, :3] = self._motion[before, :3, :3] @ part @ self._smooth[:, :3, :3]
        return moved

    def points(self, points: NDArray[np.float64], seen: NDArray[np.int64], told: int) -> NDArray[np.float64]:
        """Map points (M, 3) where they are known to be now.

        Args:
            points: as they were told at one frame.
            seen: (M,) frames, counted from 0, from which they were seen. told: that frame.
        """
        taken_back = inverse(self._jump[told])
        smooth = points @ taken_back[:3, :3].T + taken_back[:3, 3]
        return self._blended(*self._around(seen), smooth) if len(self._at) else smooth

    def _around(self, frame: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """The places before and after frames, and how much the latter counts (M,)."""
        after = np.searchsorted(self._at, frame)
        before, after = np.maximum(after - 1, 0), np.minimum(after, len(self._at) - 1)
        span = np.maximum(self._at[after] - self._at[before], 1)
        return before, after, np.clip((frame - self._at[before]) / span, 0.0, 1.0)

    def _blended(
        self,
        before: NDArray[np.int64],
        after: NDArray[np.int64],
        share: NDArray[np.float64],
        points: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        a, b = self._motion[before], self._motion[after]
        by_a = np.einsum("nij,nj->ni", a[:, :3, :3], points) + a[:, :3, 3]
        by_b = np.einsum("nij,nj->ni", b[:, :3, :3], points) + b[:, :3, 3]
        return np.asarray((1.0 - share[:, None]) * by_a + share[:, None] * by_b)


def _jumps(corrections: Sequence[tuple[int, NDArray[np.float64]]], n_frames: int) -> NDArray[np.float64]:
    """What closing loops had moved the map by, when each frame (N,) was told (N, 4, 4)."""
    jump, total = np.tile(np.eye(4), (n_frames, 1, 1)), make_pose(np.eye(3), np.zeros(3))
    for index, motion in corrections:
        total = then(motion, total)
        jump[index - 1 :] = total
    return jump
