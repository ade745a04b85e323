"""The ground that the car saw: free, obstacle or unseen, from dense stereo on small images."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.ground_plane import GroundPlane, fit_ground_plane, level_plane
from autowaze.world.camera import StereoCamera
from autowaze.world.frame import Image, StereoFrame
from autowaze.world.ground import CELL_M
from autowaze.world.pose import Pose


@dataclass(frozen=True, slots=True)
class GroundSettings:
    """What can be set about the ground grid.

    Attributes:
        camera_height_m: range of plausible heights of the camera over the road; it is measured within it.
        max_range_m: cells farther from the camera stay unseen, and those where depth is less exact than this:
        depth_error_m: what `disparity_error_px` of the small images come to at a cell.
        disparity_error_px: of dense stereo.
        ground_tolerance_m: points so near to the plane are ground.
        obstacle_bottom_m, obstacle_top_m: heights between which something standing is an obstacle.
        min_obstacle_share: share of the pixels of a half-metre-high thing as wide as the cell that make an obstacle.
        nearest_m: what is nearer need not be matched, so far as `n_disparities` allow.
        n_disparities: the most that the small images are searched for, a multiple of 16.
        enough_bf: focal length (px) times baseline (m) from which on images of half size do: a disparity that is off by
            0.3 px puts what is 10 m away half a metre off, two cells. Images of cameras with less keep their width and
            lose two thirds of their height, which takes as long.
    """

    camera_height_m: tuple[float, float] = (1.0, 2.4)
    max_range_m: float = 25.0
    depth_error_m: float = 1.0
    disparity_error_px: float = 0.3
    ground_tolerance_m: float = 0.17
    obstacle_bottom_m: float = 0.3
    obstacle_top_m: float = 2.0
    min_obstacle_share: float = 0.15
    nearest_m: float = 2.0
    n_disparities: int = 64
    enough_bf: float = 60.0


@dataclass(frozen=True)
class GroundObservation:
    """What one frame saw of the ground.

    Attributes:
        ix, iy: (N,) int32 cells of the map's ground plane, `CELL_M` wide, each once.
        free, obstacle: (N,) bool, never both.
        depth: (h, w) float32 metres along the optical axis of the left camera; NaN where stereo has no answer.
        camera: the camera of small images that the depth map belongs to.
        plane: the road's plane in that camera; None where none was found, and then there are no cells.
    """

    ix: NDArray[np.int32]
    iy: NDArray[np.int32]
    free: NDArray[np.bool_]
    obstacle: NDArray[np.bool_]
    depth: NDArray[np.float32]
    camera: StereoCamera
    plane: GroundPlane | None


class GroundObserver:
    """Sees the ground of one stereo frame after the other."""

    def __init__(self, camera: StereoCamera, settings: GroundSettings = GroundSettings()) -> None:
        self.camera = camera
        self.settings = settings
        half = camera.scaled(0.5)
        self._small = half if half.bf >= settings.enough_bf else camera.scaled(1 / 3, 1.0)
        exact_m = float(np.sqrt(settings.depth_error_m * self._small.bf / settings.disparity_error_px))
        self._range_m = min(settings.max_range_m, exact_m)
        self._plane = level_plane(self._small, float(np.mean(settings.camera_height_m)))
        needed = int(np.ceil(self._small.bf / settings.nearest_m / 16)) * 16
        self._n_disparities = min(needed, settings.n_disparities)
        self._matcher = _matcher(self._n_disparities)

    def disparity(self, frame: StereoFrame) -> NDArray[np.float32]:
        """Disparity (h, w) float32 px of the small images, negative where unknown."""
        n = self._n_disparities
        # The matcher leaves out as many columns as it searches: without the border, parked cars on the left get lost.
        left, right = (
            cv2.copyMakeBorder(self._shrink(image), 0, 0, n, 0, cv2.BORDER_REPLICATE)
            for image in (frame.left_grey, frame.right_grey)
        )
        disparity = self._matcher.compute(left, right)[:, n:].astype(np.float32) / np.float32(16)
        in_right_image = disparity <= np.arange(disparity.shape[1], dtype=np.float32)
        return np.where(in_right_image, disparity, np.float32(-1))

    def cells_of(
        self,
        disparity: NDArray[np.float32],
        T_map_cam: Pose,
        instances_moving_mask: NDArray[np.bool_] | None = None,
    ) -> GroundObservation:
        """Cells and depth of a frame whose `disparity` is known; pixels of the mask (H, W) do not vote."""
        depth = np.where(disparity > 0, np.float32(self._small.bf) / np.where(disparity > 0, disparity, 1), np.nan)
        plane = fit_ground_plane(disparity, self._small, self.settings.camera_height_m, self._plane)
        if plane is None:
            nothing, nobody = np.zeros(0, np.int32), np.zeros(0, np.bool_)
            return GroundObservation(nothing, nothing, nobody, nobody, depth.astype(np.float32), self._small, None)
        self._plane = plane
        voting = disparity if instances_moving_mask is None else self._without(disparity, instances_moving_mask)
        ix, iy, free, obstacle = _vote(voting, plane, self._small, T_map_cam, self.settings, self._range_m)
        return GroundObservation(ix, iy, free, obstacle, depth.astype(np.float32), self._small, plane)

    def _shrink(self, image: Image) -> Image:
        size = (self._small.width, self._small.height)
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def _without(self, disparity: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Disparity with the pixels of a full-size mask, and a rim around them, unknown."""
        size = (self._small.width, self._small.height)
        small = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
        grown = cv2.dilate(small, np.ones((5, 5), np.uint8)) > 0
        return np.where(grown, np.float32(-1), disparity)


def _matcher(n_disparities: int) -> cv2.StereoSGBM:
    block = 5
    return cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=n_disparities,
        blockSize=block,
        P1=8 * block**2,
        P2=32 * block**2,
        disp12MaxDiff=1,
        preFilterCap=31,
        uniquenessRatio=10,
        speckleWindowSize=60,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )


def _vote(
    disparity: NDArray[np.float32],
    plane: GroundPlane,
    camera: StereoCamera,
    T_map_cam: Pose,
    s: GroundSettings,
    range_m: float,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.bool_], NDArray[np.bool_]]:
    """Cells that a frame saw within a range, and which of them are free or hold an obstacle."""
    reach = int(np.ceil(range_m / CELL_M)) + 1
    corner = np.floor(T_map_cam[:2, 3] / CELL_M).astype(np.int64) - reach
    counts = np.zeros((2, 2 * reach + 1, 2 * reach + 1), np.int32)
    rays = T_map_cam[:2, :3] @ np.linalg.inv(camera.K)
    heights = (-s.ground_tolerance_m, s.ground_tolerance_m, s.obstacle_bottom_m, s.obstacle_top_m)
    _count_pixels(
        disparity,
        np.array([plane.a, plane.b, plane.c, plane.height_m]),
        np.column_stack([rays, T_map_cam[:2, 3] / CELL_M - corner]),
        camera.bf,
        range_m,
        np.array(heights),
        counts,
    )
    ground, standing = counts
    cx, cy = np.nonzero(ground + standing)
    centre = (np.stack([cx, cy], axis=1) + corner + 0.5) * CELL_M
    distance = np.maximum(np.linalg.norm(centre - T_map_cam[:2, 3], axis=1), 1.0)
    expected = 0.5 * CELL_M * camera.fx * camera.fy / distance**2
    obstacle = standing[cx, cy] >= np.maximum(s.min_obstacle_share * expected, 3.0)
    free = ~obstacle & (ground[cx, cy] > standing[cx, cy])
    seen = obstacle | free
    return (
        (cx[seen] + corner[0]).astype(np.int32),
        (cy[seen] + corner[1]).astype(np.int32),
        free[seen],
        obstacle[seen],
    )


@numba.njit(cache=True, nogil=True)
def _count_pixels(
    disparity: NDArray[np.float32],
    plane: NDArray[np.float64],
    to_cells: NDArray[np.float64],
    bf: float,
    max_range: float,
    heights: NDArray[np.float64],
    counts: NDArray[np.int32],
) -> None:
    """Count ground and standing pixels per cell.

    `to_cells` (2, 4): rays of pixels (u, v, 1) on the map's ground plane, and the camera's place in cells.
    """
    a, b, c, camera_height = plane
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = disparity[v, u]
            if d * max_range < bf:
                continue
            # The plane's disparity over the pixel's is the share of the way down to the ground.
            height = camera_height * (1.0 - (a * u + b * v + c) / d)
            if height < heights[0] or height > heights[3] or heights[1] < height < heights[2]:
                continue
            ground = height <= heights[1]
            z = bf / d / CELL_M
            # A row of pixels sees a strip of ground, half a metre deep at 18 m.
            strip = z * z * CELL_M * b / bf if ground else 0.0
            steps = int(strip) + 1
            ray_x = to_cells[0, 0] * u + to_cells[0, 1] * v + to_cells[0, 2]
            ray_y = to_cells[1, 0] * u + to_cells[1, 1] * v + to_cells[1, 2]
            for step in range(steps):
                z_step = z + strip * ((step + 0.5) / steps - 0.5)
                x, y = ray_x * z_step + to_cells[0, 3], ray_y * z_step + to_cells[1, 3]
                if 0 <= x < counts.shape[1] and 0 <= y < counts.shape[2]:
                    counts[0 if ground else 1, int(x), int(y)] += 1
