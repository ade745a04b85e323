"""Trajectories on disk as other systems and evo write and read them: TUM and KITTI.

TUM: a line `time x y z qx qy qz qw` per pose. KITTI: a line of twelve numbers, the first three rows of the pose, one
per frame. Poses take camera coordinates (x right, y down, z forward) to any fixed frame, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from autowaze.world.errors import AutowazeError

SAME_TIME_S = 0.01
"""How far apart two times of one frame may be; evo's default."""
MOST_BYTES = 1 << 30
_TUM_COLUMNS, _KITTI_COLUMNS = 8, 12
_ORTHONORMAL = 1e-2


@dataclass(frozen=True)
class TrajectoryFile:
    """What a file says.

    Attributes:
        source: names the file in errors.
        timestamp: (N,) float64, seconds, ascending; None for KITTI, which has none.
        T_world_cam: (N, 4, 4) float64, metres.
    """

    source: str
    timestamp: NDArray[np.float64] | None
    T_world_cam: NDArray[np.float64]

    def matched(self, timestamp: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The frames (M,) of a drive with these times (N,) that it has poses for, and the poses (M, 4, 4).

        Raises:
            AutowazeError: fewer than 3, or for KITTI not one per frame.
        """
        if self.timestamp is None:
            if len(self.T_world_cam) != len(timestamp):
                raise AutowazeError(
                    f"{self.source}: {len(self.T_world_cam)} poses without times for a drive of {len(timestamp)} "
                    "frames: give one per frame, or a TUM file with times"
                )
            return np.arange(len(timestamp)), self.T_world_cam
        later = np.clip(np.searchsorted(self.timestamp, timestamp), 1, len(self.timestamp) - 1)
        earlier_is_nearer = timestamp - self.timestamp[later - 1] < self.timestamp[later] - timestamp
        row = later - earlier_is_nearer
        frames = np.flatnonzero(np.abs(self.timestamp[row] - timestamp) <= SAME_TIME_S)
        if len(frames) < 3:
            raise AutowazeError(
                f"{self.source}: {len(frames)} poses within {SAME_TIME_S} s of a frame; its times run from "
                f"{self.timestamp[0]:.3f} to {self.timestamp[-1]:.3f} s, the drive's from {timestamp[0]:.3f} to "
                f"{timestamp[-1]:.3f} s"
            )
        return frames, self.T_world_cam[row[frames]]


def read_trajectory(path: str | Path) -> TrajectoryFile:
    """Read a file in TUM or KITTI format; the number of columns tells which.

    Raises:
        AutowazeError: it cannot be read or is neither.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise AutowazeError(f"{path}: larger than {MOST_BYTES >> 20} MiB: no trajectory of one drive")
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise AutowazeError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise AutowazeError(f"{path}: not text, so neither a TUM nor a KITTI trajectory") from error
    rows = [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    columns = {len(row) for row in rows}
    if len(rows) < 3 or columns not in ({_TUM_COLUMNS}, {_KITTI_COLUMNS}):
        raise AutowazeError(f"{path}: expected 3 or more lines of 8 numbers (TUM) or of 12 numbers (KITTI)")
    try:
        values = np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise AutowazeError(f"{path}: {error}") from error
    if not np.isfinite(values).all():
        raise AutowazeError(
            f"{path}: line {int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0]) + 1} is not finite"
        )
    return _tum(values, str(path)) if columns == {_TUM_COLUMNS} else _kitti(values, str(path))


def write_tum(path: str | Path, timestamp: NDArray[np.float64], T_world_cam: NDArray[np.float64]) -> None:
    """Write poses (N, 4, 4) with their times (N,) as `evo_traj tum` reads them; raises `AutowazeError`."""
    quaternion = Rotation.from_matrix(T_world_cam[:, :3, :3]).as_quat()
    rows = zip(timestamp.tolist(), T_world_cam[:, :3, 3].tolist(), quaternion.tolist(), strict=True)
    lines = [f"{time:.9f} " + " ".join(f"{value:.9f}" for value in (*xyz, *q)) for time, xyz, q in rows]
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise AutowazeError(f"{path}: cannot be written: {error.strerror}") from error


def _tum(values: NDArray[np.float64], source: str) -> TrajectoryFile:
    order = np.argsort(values[:, 0], kind="stable")
    values = values[order]
    length = np.linalg.norm(values[:, 4:], axis=1)
    if (np.abs(length - 1.0) > _ORTHONORMAL).any():
        raise AutowazeError(f"{source}: a quaternion has not length 1: expected time x y z qx qy qz qw")
    T = np.tile(np.eye(4), (len(values), 1, 1))
    T[:, :3, :3] = Rotation.from_quat(values[:, 4:]).as_matrix()
    T[:, :3, 3] = values[:, 1:4]
    return TrajectoryFile(source, values[:, 0], T)


def _kitti(values: NDArray[np.float64], source: str) -> TrajectoryFile:
    T = np.tile(np.eye(4), (len(values), 1, 1))
    T[:, :3] = values.reshape(-1, 3, 4)
    R = T[:, :3, :3]
    if np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max() > _ORTHONORMAL:
        raise AutowazeError(f"{source}: a pose is no rotation and translation: expected the rows of 3 x 4 matrices")
    return TrajectoryFile(source, None, T)
