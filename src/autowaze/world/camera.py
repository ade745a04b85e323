"""The rectified stereo camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import AutowazeError


@dataclass(frozen=True, slots=True)
class StereoCamera:
    """A rectified pinhole pair; both images share one camera matrix.

    Focal lengths and principal point in pixels, baseline in metres, size in pixels. The camera frame is the left
    one's: x right, y down, z forward.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    baseline_m: float
    width: int
    height: int

    def __post_init__(self) -> None:
        values = (self.fx, self.fy, self.cx, self.cy, self.baseline_m)
        if not all(np.isfinite(values)) or min(self.fx, self.fy, self.baseline_m) <= 0:
            raise AutowazeError(f"impossible stereo calibration {self}: focal lengths and baseline must be > 0")
        if min(self.width, self.height) < 1:
            raise AutowazeError(f"impossible image size {self.width} x {self.height}")

    @property
    def K(self) -> NDArray[np.float64]:  # noqa: N802
        """Camera matrix, 3 x 3."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def bf(self) -> float:
        """Focal length times baseline (px m): depth = bf / disparity."""
        return self.fx * self.baseline_m

    def project(self, points_cam: NDArray[np.floating]) -> NDArray[np.float64]:
        """Project points (N, 3) in the camera frame to (N, 3) rows of u, v, u_right in pixels.

        Points need z > 0.
        """
        x, y, z = np.asarray(points_cam, dtype=np.float64).T
        u = self.fx * x / z + self.cx
        return np.stack([u, self.fy * y / z + self.cy, u - self.bf / z], axis=1)

    def back_project(self, uv: NDArray[np.floating], depth: NDArray[np.floating]) -> NDArray[np.float64]:
        """Points (N, 3) in the camera frame, metres, of pixels (N, 2) at depths (N,) in metres."""
        uv = np.asarray(uv, dtype=np.float64)
        z = np.asarray(depth, dtype=np.float64)
        return np.stack([(uv[:, 0] - self.cx) * z / self.fx, (uv[:, 1] - self.cy) * z / self.fy, z], axis=1)

    def scaled(self, factor: float, factor_of_width: float | None = None) -> StereoCamera:
        """The camera of images resized by `factor`, the width by another if given (pixel centres at integers)."""
        across = factor if factor_of_width is None else factor_of_width
        width, height = round(self.width * across), round(self.height * factor)
        sx, sy = width / self.width, height / self.height
        return StereoCamera(
            self.fx * sx,
            self.fy * sy,
            (self.cx + 0.5) * sx - 0.5,
            (self.cy + 0.5) * sy - 0.5,
            self.baseline_m,
            width,
            height,
        )
