"""Features of known points, as a noisy stereo camera sees them."""

import numpy as np

from autowaze.world.camera import StereoCamera
from autowaze.world.features import CameraFeatures
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import heading_to_rotation, inverse, make_pose, transform

CAMERA = StereoCamera(720.0, 720.0, 620.0, 187.0, 0.54, 1240, 375)


def camera_at(east, north, heading=0.0):
    return make_pose(heading_to_rotation(heading), np.array([east, north, 1.65]))


def see(points_map, T_map_cam, descriptors, instance, noise=None, sigma_px=0.4, label=ClassLabel.CAR, camera=CAMERA):
    """Features of points (N, 3) in the map; `instance` is one id or (N,) of them."""
    uvr = camera.project(transform(inverse(T_map_cam), points_map))
    if noise is not None:
        uvr = uvr + noise.normal(0.0, sigma_px, uvr.shape)
    depth = camera.bf / (uvr[:, 0] - uvr[:, 2])
    n = len(points_map)
    ids = np.broadcast_to(np.asarray(instance, np.int32), n).copy()
    return CameraFeatures(
        uv=uvr[:, :2].astype(np.float32),
        octave=np.zeros(n, np.uint8),
        angle=np.zeros(n, np.float32),
        descriptor=descriptors,
        u_right=uvr[:, 2].astype(np.float32),
        depth=depth.astype(np.float32),
        position_cam=camera.back_project(uvr[:, :2], depth).astype(np.float32),
        label=np.where(ids > 0, label, ClassLabel.BACKGROUND).astype(np.uint8),
        instance_id=ids,
    )


def random_descriptors(rng, n):
    return rng.integers(0, 256, (n, 32), dtype=np.uint8)


def car_side(rng, n, east, north, length=4.0):
    """Points on the street side of a car parked along the street that runs north."""
    return np.column_stack(
        [np.full(n, east) + rng.normal(0, 0.1, n), rng.uniform(north, north + length, n), rng.uniform(0.3, 1.4, n)]
    )
