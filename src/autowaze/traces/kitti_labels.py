"""KITTI tracking labels: 2D and 3D boxes of objects by frame and track."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autowaze.world.columns import Columns
from autowaze.world.errors import TraceError

_COLUMNS = 17


@dataclass
class ObjectLabels(Columns):
    """Labelled objects, N rows; ground truth, for evaluation only.

    Attributes:
        frame: (N,) int64, frame number.
        track_id: (N,) int64, consistent over the drive.
        kind: (N,) str, KITTI's type: Car, Van, Truck, Pedestrian, Cyclist, …
        box: (N, 4) float64, left, top, right, bottom in pixels.
        size: (N, 3) float64, height, width, length in metres.
        position_cam: (N, 3) float64, bottom centre of the box in the rectified reference camera, metres.
        yaw: (N,) float64, radians about the camera's vertical, KITTI's rotation_y.
    """

    frame: NDArray[np.int64]
    track_id: NDArray[np.int64]
    kind: NDArray[np.str_]
    box: NDArray[np.float64]
    size: NDArray[np.float64]
    position_cam: NDArray[np.float64]
    yaw: NDArray[np.float64]


def read_labels(path: str | Path) -> ObjectLabels:
    """Read a tracking label file; DontCare regions are left out.

    Raises:
        TraceError: the file is missing or is no label file.
    """
    path = Path(path)
    try:
        rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise TraceError(f"{path}: cannot be read: {error}") from error
    kept = [row for row in rows if len(row) >= _COLUMNS and row[2] != "DontCare"]
    if any(len(row) < _COLUMNS for row in rows) or not kept:
        raise TraceError(f"{path}: expected rows of {_COLUMNS} columns as KITTI's tracking labels have")
    try:
        numbers = np.array([row[:2] + row[3:_COLUMNS] for row in kept], dtype=np.float64)
    except ValueError as error:
        raise TraceError(f"{path}: expected numbers: {error}") from error
    return ObjectLabels(
        frame=numbers[:, 0].astype(np.int64),
        track_id=numbers[:, 1].astype(np.int64),
        kind=np.array([row[2] for row in kept]),
        box=numbers[:, 5:9],
        size=numbers[:, 9:12],
        position_cam=numbers[:, 12:15],
        yaw=numbers[:, 15],
    )
