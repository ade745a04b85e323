"""Rigid motions as 4 x 4 matrices; `T_a_b` takes coordinates in frame b to frame a."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Pose = NDArray[np.float64]
"""A 4 x 4 rigid transform."""

_SMALL_ANGLE_RAD = 1e-9


def make_pose(rotation: NDArray[np.floating], translation: NDArray[np.floating]) -> Pose:
    """Pose of a 3 x 3 rotation and a 3-vector in metres."""
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = translation
    return T


def inverse(T: Pose) -> Pose:
    """Inverse of a rigid transform, or of a stack (..., 4, 4) of them."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out = np.zeros(T.shape, T.dtype)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -(R_t @ T[..., :3, 3, None])[..., 0] if T.ndim > 2 else -(R_t @ T[:3, 3])
    out[..., 3, 3] = 1.0
    return out


def transform(T: Pose, points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Points (N, 3) taken through the pose."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3], dtype=np.float64)


def skew(v: NDArray[np.floating]) -> NDArray[np.float64]:
    """Cross-product matrix of a 3-vector."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def so3_exp(omega: NDArray[np.floating]) -> NDArray[np.float64]:
    """Rotation matrix of a rotation vector in radians (Rodrigues)."""
    angle = float(np.linalg.norm(omega))
    W = skew(omega)
    if angle < _SMALL_ANGLE_RAD:
        return np.eye(3) + W
    return np.asarray(
        np.eye(3) + np.sin(angle) / angle * W + (1.0 - np.cos(angle)) / angle**2 * (W @ W), dtype=np.float64
    )


def so3_log(R: NDArray[np.floating]) -> NDArray[np.float64]:
    """Rotation vector in radians of a rotation matrix, via the unit quaternion (stable at 0 and at pi)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_rotvec(), dtype=np.float64)


def heading_to_rotation(heading_rad: float) -> NDArray[np.float64]:
    """R_map_cam of a level camera that looks along a compass heading (clockwise from north, radians).

    Camera x right, y down, z forward; map east, north, up.
    """
    s, c = np.sin(heading_rad), np.cos(heading_rad)
    return np.array([[c, 0.0, s], [-s, 0.0, c], [0.0, -1.0, 0.0]])


def heading_of(T_map_cam: Pose) -> float:
    """Compass heading (clockwise from north, radians in (-pi, pi]) of a camera's optical axis."""
    return float(np.arctan2(T_map_cam[0, 2], T_map_cam[1, 2]))
