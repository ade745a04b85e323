"""Camera features made ready for matching and for optimisation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures

CELL_PX = 24


class ObservedFrame:
    """Features of one frame, sorted into image cells.

    Attributes:
        features: the features as they came (N rows).
        words: (N, 4) uint64, the descriptors.
        measured: (N, 3) float64, u, v and disparity in pixels; disparity NaN without a stereo match.
        information: (N, 2) float64, inverse variance of u and v, and of the disparity (0 where it is far away or not
            known), px^-2.
        cell_start, in_cell: rows of the features by image cell, in compressed form.
        cell_measured, cell_octave: `measured` and `octave` in that order, as the search of a window reads them.
        n_columns: cells per row of cells.
        moving: (N,) bool, features on things known to move.
    """

    def __init__(
        self,
        features: CameraFeatures,
        camera: StereoCamera,
        level_scale: NDArray[np.float64],
        sigma_px: tuple[float, float],
        close_baselines: float,
        moving: NDArray[np.bool_] | None = None,
    ) -> None:
        self.features = features
        self.uv = np.ascontiguousarray(features.uv, dtype=np.float64)
        self.words = np.ascontiguousarray(features.descriptor).view(np.uint64)
        self.octave = features.octave.astype(np.int64)
        self.moving = np.zeros(len(features), np.bool_) if moving is None else np.asarray(moving, dtype=np.bool_)
        disparity = self.uv[:, 0] - features.u_right
        self.measured = np.column_stack([self.uv, disparity])
        corner, patch = sigma_px[0] * level_scale[self.octave], sigma_px[1] * level_scale[self.octave]
        close = disparity >= camera.fx / close_baselines  # false for NaN
        self.information = np.column_stack([corner**-2, np.where(close, patch**-2, 0.0)])
        self.n_columns = camera.width // CELL_PX + 1
        self.n_rows = camera.height // CELL_PX + 1
        column, row = (self.uv / CELL_PX).astype(np.int64).T
        cell = np.clip(row, 0, self.n_rows - 1) * self.n_columns + np.clip(column, 0, self.n_columns - 1)
        self.in_cell = np.argsort(cell, kind="stable")
        count = np.bincount(cell, minlength=self.n_columns * self.n_rows)
        self.cell_start = np.concatenate([np.zeros(1, np.int64), np.cumsum(count)])
        self.cell_measured, self.cell_octave = self.measured[self.in_cell], self.octave[self.in_cell]

    def __len__(self) -> int:
        return len(self.features)
