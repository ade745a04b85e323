"""ORB features of one image, spread over it (Rublee et al. 2011; spreading after ORB-SLAM2)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.pyramid import PyramidLayout
from autowaze.world.columns import Columns
from autowaze.world.frame import Image

_BORDER_PX = 19  # half the descriptor's patch plus its rotation
_CANDIDATES_PER_FEATURE = 3.0  # what the spreading chooses from
_CELLS_PER_FEATURE = 1.0


@dataclass
class Keypoints(Columns):
    """Corners of one image, N rows.

    Attributes:
        uv: (N, 2) float32 pixels of the full image.
        octave: (N,) uint8. angle: (N,) float32, radians.
        descriptor: (N, 32) uint8.
    """

    uv: NDArray[np.float32]
    octave: NDArray[np.uint8]
    angle: NDArray[np.float32]
    descriptor: NDArray[np.uint8]


class OrbDetector:
    """Finds many corners and keeps those that cover the image best."""

    def __init__(self, n_features: int, layout: PyramidLayout, fast_threshold: int) -> None:
        self.n_features = n_features
        self.layout = layout
        n_levels, scale_factor = len(layout.scale), float(layout.scale[1])
        self._quota = level_quota(n_features, n_levels, scale_factor)
        self._orb = cv2.ORB_create(
            nfeatures=int(_CANDIDATES_PER_FEATURE * n_features),
            scaleFactor=scale_factor,
            nlevels=n_levels,
            edgeThreshold=_BORDER_PX,
            fastThreshold=fast_threshold,
        )

    def detect(self, image: Image) -> Keypoints:
        """Features of a grey image."""
        candidates = self._orb.detect(image)
        if not candidates:
            return _no_keypoints()
        uv = np.asarray(cv2.KeyPoint_convert(candidates), dtype=np.float32)
        response = np.fromiter((k.response for k in candidates), np.float32, len(candidates))
        octave = np.fromiter((k.octave for k in candidates), np.uint8, len(candidates))
        chosen = spread(uv, octave, response, self._quota, (image.shape[1], image.shape[0]))
        kept, descriptor = self._orb.compute(image, [candidates[i] for i in chosen])
        octave = octave[chosen]
        xy_level = np.rint(np.asarray(cv2.KeyPoint_convert(kept)) / self.layout.scale[octave][:, None])
        return Keypoints(
            uv=self.layout.to_image(xy_level, octave).astype(np.float32),
            octave=octave,
            angle=np.fromiter((np.deg2rad(k.angle) for k in kept), np.float32, len(kept)),
            descriptor=descriptor,
        )


def level_quota(n_features: int, n_levels: int, scale_factor: float) -> NDArray[np.int64]:
    """Features per pyramid level (L,), in geometric proportion, that sum to `n_features`."""
    share = (1.0 / scale_factor) ** np.arange(n_levels)
    quota = np.rint(n_features * share / share.sum()).astype(np.int64)
    quota[-1] += n_features - quota.sum()
    return quota


def spread(
    uv: NDArray[np.float32],
    octave: NDArray[np.uint8],
    response: NDArray[np.float32],
    quota: NDArray[np.int64],
    size: tuple[int, int],
) -> NDArray[np.int64]:
    """Rows of the corners to keep: the best of every cell, then the second best, up to each level's quota.

    Args:
        uv: (N, 2) pixels of the full image. octave: (N,). response: (N,), comparable within a level.
        quota: (L,) features per level.
        size: width and height of the image in pixels.
    """
    cell_px = np.sqrt(size[0] * size[1] / (_CELLS_PER_FEATURE * np.maximum(quota, 1)))[octave]
    column, row = (uv / cell_px[:, None]).astype(np.int64).T
    cell = (octave.astype(np.int64) << 40) + (row << 20) + column
    by_cell = np.lexsort((-response, cell))
    starts = np.flatnonzero(np.diff(cell[by_cell], prepend=-1))
    rank = np.empty(len(cell), np.int64)
    rank[by_cell] = np.arange(len(cell)) - np.repeat(starts, np.diff(starts, append=len(cell)))
    by_level = np.lexsort((-response, rank, octave))
    level = octave[by_level]
    first = np.searchsorted(level, np.arange(len(quota)))
    return by_level[np.arange(len(cell)) - first[level] < quota[level]]


def _no_keypoints() -> Keypoints:
    return Keypoints(
        np.zeros((0, 2), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.float32), np.zeros((0, 32), np.uint8)
    )
