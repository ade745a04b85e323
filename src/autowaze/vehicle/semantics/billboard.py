"""The visible side of an instance as an upright rectangle in the map, so that its box can be foretold from elsewhere.

A plane's inverse depth is linear in the image, so the depths at the left and right edge of a box place the side of a
car that stands along the kerb as well as the back of one straight ahead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.instance_depth import InstanceDepths
from autowaze.world.camera import StereoCamera
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import Pose, inverse, transform

_NEAREST_M = 0.5  # corners closer to the image plane, or behind it, are taken to be here
_TOLERANCE_M, _DISPARITY_SIGMA_PX, _SIGMAS = 2.0, 0.5, 4.0
_MAX_DISAGREEMENTS = 2
_DEPTH_GAIN = 0.5
_MAX_GROWTH = 1.2  # of a box from one frame to the next, beyond what ego motion explains
_SAME_SHAPE = 0.1  # logarithm by which the ratio of width and height may change from one frame to the next
_BORDER_PX = 2.0
_DWARF = 0.3  # of the usual height: what would be so low at the depth that it was followed to is not there
_WIDEST_SHARE = 0.9  # of the largest area ever seen of a side: what is smaller is partly hidden

HEIGHT_M = np.full(len(ClassLabel), 1.0)
"""Usual heights by class, to place what stereo cannot."""
HEIGHT_M[[ClassLabel.CAR, ClassLabel.TWO_WHEELER, ClassLabel.PERSON]] = 1.5, 1.5, 1.7
HEIGHT_M[[ClassLabel.TRUCK, ClassLabel.BUS]] = 3.0


class Billboards:
    """Where in the map the visible sides of the tracks stand, one row per track."""

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera
        self._corners = np.zeros((0, 4, 3))
        self._widest = np.zeros((0, 4, 3))
        self._disagreements = np.zeros(0, np.int64)
        self._measured = np.zeros(0, np.bool_)
        self._T_map_cam: Pose | None = None

    @property
    def placed(self) -> NDArray[np.bool_]:
        """Tracks (T,) whose place rests on stereo, not on a guess from their size."""
        return self._measured

    @property
    def ahead(self) -> NDArray[np.bool_]:
        """Tracks (T,) of which some part is before the camera; those without a place are taken to be."""
        if self._T_map_cam is None:
            return np.ones(len(self._corners), np.bool_)
        edges = self._project(self._corners, self._T_map_cam)[1]
        return np.asarray(~(edges.max(axis=1) < _NEAREST_M))

    def add(self, n: int) -> None:
        """Append tracks without a place."""
        self._corners = np.concatenate([self._corners, np.full((n, 4, 3), np.nan)])
        self._widest = np.concatenate([self._widest, np.full((n, 4, 3), np.nan)])
        self._disagreements = np.concatenate([self._disagreements, np.zeros(n, np.int64)])
        self._measured = np.concatenate([self._measured, np.zeros(n, np.bool_)])

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Drop the other tracks."""
        self._corners, self._disagreements = self._corners[rows], self._disagreements[rows]
        self._widest = self._widest[rows]
        self._measured = self._measured[rows]

    def shift(self, T_map_cam: Pose | None) -> NDArray[np.float64]:
        """Motion (T, 4) of the boxes' edges since the frame before, were they to stand, px; zero where unknown."""
        before, self._T_map_cam = self._T_map_cam, T_map_cam
        if before is None or T_map_cam is None:
            return np.zeros((len(self._corners), 4))
        then, _ = self._project(self._corners, before)
        now, _ = self._project(self._corners, T_map_cam)
        return np.nan_to_num(now - then)

    def widest_boxes(self) -> NDArray[np.float64]:
        """Boxes (T, 4) in this frame of the sides as they were seen when least was hidden; NaN where unknown."""
        if self._T_map_cam is None:
            return np.full((len(self._corners), 4), np.nan)
        return self._project(self._widest, self._T_map_cam)[0]

    def depth(self) -> NDArray[np.float64]:
        """Depth (T,) in metres at which each track should be seen in this frame; NaN unless stereo placed it."""
        if self._T_map_cam is None:
            return np.full(len(self._corners), np.nan)
        _, edges = self._project(self._corners, self._T_map_cam)
        return np.where(self._measured, edges.mean(axis=1), np.nan)

    def distance(self, boxes: NDArray[np.floating], depths: InstanceDepths) -> NDArray[np.float64]:
        """Metres (D, T) over ground from the middle of what is seen in boxes (D, 4) to where each track stands.

        Across the line of sight where the depth of what is seen is unknown; infinite for what lies behind.
        """
        nearest = np.full((len(boxes), len(self._corners)), np.inf)
        if self._T_map_cam is None:
            return nearest
        u = (boxes[:, 0] + boxes[:, 2])[:, None] / 2
        measured = (depths.left + depths.right)[:, None] / 2
        for side in (self._corners, self._widest):
            x, _, z = transform(inverse(self._T_map_cam), side.mean(axis=1)).T[:, None]
            depth = np.where(np.isfinite(measured), measured, z)
            away = np.hypot((u - self.camera.cx) / self.camera.fx * depth - x, depth - z)
            nearest = np.fmin(nearest, np.where(z > _NEAREST_M, away, np.inf))
        return nearest

    def forget_place(self, rows: NDArray[np.int64]) -> None:
        """Let these tracks be placed by the next measurement alone."""
        self._measured[rows] = False

    def tolerance(self, depth: NDArray[np.float64]) -> NDArray[np.float64]:
        """By how many metres two depths of one thing may differ."""
        return np.asarray(_TOLERANCE_M + _SIGMAS * _DISPARITY_SIGMA_PX * depth**2 / self.camera.bf)

    def place(
        self,
        rows: NDArray[np.int64],
        boxes: NDArray[np.float32],
        labels: NDArray[np.uint8],
        depths: InstanceDepths,
    ) -> None:
        """Take in where the tracks of these rows were seen in this frame.

        A measured depth moves a track's place half the way. One that contradicts the place is doubted twice, as
        something thin may stand in front. Without a good measurement the depth follows the height of the box, and
        begins anew by it where ego motion has carried it off: what moves ahead of us is never come nearer to.
        """
        if self._T_map_cam is None:
            return
        standing, expected = self._project(self._corners[rows], self._T_map_cam)
        followed = expected * self._growth(standing, boxes)[:, None]
        by_size = HEIGHT_M[labels] * self.camera.fy / np.maximum(boxes[:, 3] - boxes[:, 1], 1.0)
        dwarfed = (followed.mean(axis=1) < _DWARF * by_size) & ~self._cut(boxes, boxes).any(axis=1)
        followed = np.where(np.isfinite(followed) & ~dwarfed[:, None], followed, by_size[:, None])
        measured = np.stack([depths.left, depths.right], axis=1)
        off = np.abs(measured.mean(axis=1) - followed.mean(axis=1))
        known = np.isfinite(off)
        agrees = known & (off <= self.tolerance(followed.mean(axis=1)))
        doubted = known & ~agrees & self._measured[rows] & (self._disagreements[rows] < _MAX_DISAGREEMENTS)
        self._disagreements[rows] = np.where(doubted, self._disagreements[rows] + 1, 0)
        blended = followed + _DEPTH_GAIN * (measured - followed)
        edges = np.where((agrees & self._measured[rows])[:, None], blended, measured)
        edges = np.where((known & ~doubted)[:, None], edges, followed)
        self._measured[rows] |= known
        self._corners[rows] = self._stand_up(boxes, np.maximum(edges, _NEAREST_M))
        grown = ~(_area(self._corners[rows]) < _WIDEST_SHARE * _area(self._widest[rows]))
        self._widest[rows] = np.where(grown[:, None, None], self._corners[rows], self._widest[rows])

    def _growth(self, standing: NDArray[np.float64], boxes: NDArray[np.float32]) -> NDArray[np.float64]:
        """Size of the standing box over that of the box seen.

        What comes nearer grows in width as in height; what another thing hides or bares changes its shape, and says
        nothing of its depth. 1 there, and where the image's border cuts either box.
        """
        cut = self._cut(standing, boxes)
        ratio = np.maximum(standing[:, 2:] - standing[:, :2], 1.0) / np.maximum(boxes[:, 2:] - boxes[:, :2], 1.0)
        width = np.where(cut[:, 0], 1.0, ratio[:, 0])
        alike = np.abs(np.log(width / ratio[:, 1])) < _SAME_SHAPE
        return np.where(alike & ~cut[:, 1], np.clip(ratio[:, 1], 1 / _MAX_GROWTH, _MAX_GROWTH), 1.0)

    def _cut(self, boxes: NDArray[np.floating], others: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Whether the image's border cuts either of two boxes (n, 4) across and upright, (n, 2)."""
        limit = np.array([self.camera.width, self.camera.height]) - 1 - _BORDER_PX
        low, high = np.minimum(boxes[:, :2], others[:, :2]), np.maximum(boxes[:, 2:], others[:, 2:])
        return np.asarray((low < _BORDER_PX) | (high > limit))

    def _stand_up(self, boxes: NDArray[np.float32], edges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Corners (n, 4, 3) in map metres of boxes (n, 4) with edges (n, 2) so many metres away."""
        left, top, right, bottom = boxes.astype(np.float64).T
        uv = np.stack([left, top, right, top, right, bottom, left, bottom], axis=1).reshape(-1, 2)
        corners = self.camera.back_project(uv, edges[:, [0, 1, 1, 0]].reshape(-1))
        assert self._T_map_cam is not None
        return transform(self._T_map_cam, corners).reshape(-1, 4, 3)

    def _project(
        self, corners: NDArray[np.float64], T_map_cam: Pose
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Boxes (n, 4) that hold the corners (n, 4, 3), cut to the image, and the depths (n, 2) of their edges."""
        points = transform(inverse(T_map_cam), corners.reshape(-1, 3))
        depth = points[:, 2].reshape(-1, 4)
        edges = np.stack([depth[:, [0, 3]].mean(axis=1), depth[:, [1, 2]].mean(axis=1)], axis=1)
        points[:, 2] = np.maximum(points[:, 2], _NEAREST_M)
        uv = self.camera.project(points)[:, :2].reshape(-1, 4, 2)
        limit = np.array([self.camera.width, self.camera.height], dtype=np.float64)
        low, high = np.clip(uv.min(axis=1), 0, limit), np.clip(uv.max(axis=1), 0, limit)
        return np.concatenate([low, high], axis=1), edges


def _area(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Square metres (n,) of upright rectangles by their corners (n, 4, 3)."""
    width = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    height = np.linalg.norm(corners[:, 3] - corners[:, 0], axis=1)
    return np.asarray(width * height)
