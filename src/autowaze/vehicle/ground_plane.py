"""The road as a plane in disparity space, where every plane of the world is linear (Labayrade et al. 2002)."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera

_SAMPLE_STEP = 4  # pixels between the rows and columns that vote for the plane
_HYPOTHESES = 300
_INLIER_PX = 0.5
_REFINEMENTS = 3
_MIN_INLIER_SHARE = 0.05
_MAX_ROLL, _MAX_PITCH = np.tan(np.radians(6.0)), np.tan(np.radians(8.0))
_SEED = 20


@dataclass(frozen=True, slots=True)
class GroundPlane:
    """Disparity of the ground at pixel (u, v): a u + b v + c.

    Attributes:
        a, b, c: coefficients for the camera that the plane was fitted with.
        height_m: distance of the camera from the plane.
    """

    a: float
    b: float
    c: float
    height_m: float


def level_plane(camera: StereoCamera, height_m: float) -> GroundPlane:
    """The ground under a camera that looks along the horizon."""
    b = camera.bf / (camera.fy * height_m)
    return GroundPlane(0.0, b, -b * camera.cy, height_m)


def fit_ground_plane(
    disparity: NDArray[np.float32], camera: StereoCamera, height_range_m: tuple[float, float], guess: GroundPlane
) -> GroundPlane | None:
    """The plane under the camera that most of the lower image agrees with (RANSAC with a fixed seed).

    Args:
        disparity: (H, W) float32 px, <= 0 where unknown.
        camera: the camera of the disparity image.
        height_range_m: plausible heights of the camera.
        guess: tried first, the plane of the frame before.

    Returns:
        None where too little ground is seen.
    """
    points = _road_candidates(disparity, camera)
    if len(points) < 50:
        return None
    rng = np.random.default_rng(_SEED)
    triples = rng.integers(0, len(points), (_HYPOTHESES, 3))
    hypotheses = np.concatenate([[[guess.a, guess.b, guess.c]], _planes_through(points[triples])])
    hypotheses = hypotheses[_plausible(hypotheses, camera, height_range_m)]
    if not len(hypotheses):
        return None
    u, v, seen = np.ascontiguousarray(points.T)
    best = hypotheses[int(np.argmax(_inlier_counts(u, v, seen, hypotheses)))]
    for _ in range(_REFINEMENTS):
        inliers = points[np.abs(_residuals(points, best)) < _INLIER_PX]
        if len(inliers) < max(_MIN_INLIER_SHARE * len(points), 10):
            return None
        design = np.column_stack([inliers[:, :2], np.ones(len(inliers))])
        best = np.linalg.lstsq(design, inliers[:, 2], rcond=None)[0]
    if not _plausible(best[None], camera, height_range_m)[0]:
        return None
    return GroundPlane(float(best[0]), float(best[1]), float(best[2]), float(_heights(best[None], camera)[0]))


def _road_candidates(disparity: NDArray[np.float32], camera: StereoCamera) -> NDArray[np.float64]:
    """Rows (N, 3) of u, v, disparity below the horizon."""
    top = int(camera.cy) + _SAMPLE_STEP
    part = disparity[top::_SAMPLE_STEP, ::_SAMPLE_STEP]
    v, u = np.nonzero(part > 1.0)
    return np.column_stack([u * _SAMPLE_STEP, v * _SAMPLE_STEP + top, part[v, u]]).astype(np.float64)


def _planes_through(triples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Planes (H, 3) through triples (H, 3, 3) of points; degenerate ones come out as zero."""
    design = triples.copy()
    design[:, :, 2] = 1.0
    regular = np.abs(np.linalg.det(design)) > 1e-3
    planes = np.zeros((len(triples), 3))
    planes[regular] = np.linalg.solve(design[regular], triples[regular, :, 2:])[:, :, 0]
    return planes


def _plausible(
    planes: NDArray[np.float64], camera: StereoCamera, height_range_m: tuple[float, float]
) -> NDArray[np.bool_]:
    """Which planes (H, 3) lie under the camera at a plausible height, nearly level."""
    normal = _normals(planes, camera)
    height = _heights(planes, camera)
    level = (np.abs(normal[:, 0]) <= _MAX_ROLL * normal[:, 1]) & (np.abs(normal[:, 2]) <= _MAX_PITCH * normal[:, 1])
    return np.asarray(level & (height >= height_range_m[0]) & (height <= height_range_m[1]))


def _normals(planes: NDArray[np.float64], camera: StereoCamera) -> NDArray[np.float64]:
    """N (H, 3) with N . X = 1 for points X of the plane in the camera frame."""
    a, b, c = planes.T
    return np.stack([a * camera.fx, b * camera.fy, a * camera.cx + b * camera.cy + c], axis=1) / camera.bf


def _heights(planes: NDArray[np.float64], camera: StereoCamera) -> NDArray[np.float64]:
    return np.asarray(1.0 / np.maximum(np.linalg.norm(_normals(planes, camera), axis=1), 1e-9))


def _residuals(points: NDArray[np.float64], plane: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(points[:, 2] - points[:, :2] @ plane[:2] - plane[2])


@numba.njit(cache=True, nogil=True)
def _inlier_counts(
    u: NDArray[np.float64], v: NDArray[np.float64], disparity: NDArray[np.float64], planes: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Points (N,) within the inlier distance of each plane (H, 3); a column of its own for each coordinate is what
    lets four points be compared at once."""
    counts = np.zeros(len(planes), np.int64)
    for h in range(len(planes)):
        a, b, c = planes[h]
        count = 0
        for i in range(len(u)):
            count += abs(disparity[i] - a * u[i] - b * v[i] - c) < _INLIER_PX
        counts[h] = count
    return counts
