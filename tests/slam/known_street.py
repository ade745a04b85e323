"""A street of points with descriptors: what a stereo camera would see of it, without images."""

from __future__ import annotations

import numpy as np

from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackedFrame
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.features import CameraFeatures
from autowaze.world.pose import heading_to_rotation, inverse, make_pose

CAMERA = StereoCamera(fx=700.0, fy=700.0, cx=620.0, cy=180.0, baseline_m=0.54, width=1240, height=370)


class Street:
    """House fronts on both sides of a road to the north."""

    def __init__(self, length_m: float = 120.0, per_metre: int = 25, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        n = int(length_m * per_metre)
        side = rng.choice([-1.0, 1.0], n)
        x, y = side * rng.uniform(6.0, 12.0, n), rng.uniform(0.0, length_m, n)
        self.position = np.column_stack([x, y, rng.uniform(-1.5, 5.0, n)])
        self.descriptor = rng.integers(0, 256, (n, 32), dtype=np.uint8)
        self.label = np.zeros(n, np.uint8)
        self.offset = np.zeros((n, 3))  # of things that moved

    def see(
        self, T_map_cam: np.ndarray, seed: int, noise_px: float = 0.4, camera: StereoCamera = CAMERA
    ) -> CameraFeatures:
        """Features of the points within 5 to 45 m, with noise in pixels, disparity and descriptors."""
        rng = np.random.default_rng(seed)
        T = inverse(T_map_cam)
        points = (self.position + self.offset) @ T[:3, :3].T + T[:3, 3]
        pixel = camera.project(np.where(points[:, 2:] > 5.0, points, [0.0, 0.0, -1.0]))
        seen = (points[:, 2] > 5.0) & (points[:, 2] < 45.0) & (pixel[:, 0] > 0) & (pixel[:, 0] < camera.width)
        seen &= (pixel[:, 1] > 0) & (pixel[:, 1] < camera.height)
        rows = np.flatnonzero(seen)
        distance = np.linalg.norm(points[rows], axis=1)
        octave = np.clip(np.rint(np.log(20.0 / distance) / np.log(1.2)) + 3, 0, 7).astype(np.uint8)
        uv = pixel[rows, :2] + rng.normal(0, noise_px, (len(rows), 2))
        disparity = camera.bf / points[rows, 2] + rng.normal(0, 0.5 * noise_px, len(rows))
        depth = camera.bf / disparity
        flipped = np.packbits(rng.random((len(rows), 256)) < 0.05, axis=1)
        return CameraFeatures(
            uv=uv.astype(np.float32),
            octave=octave,
            angle=np.zeros(len(rows), np.float32),
            descriptor=self.descriptor[rows] ^ flipped,
            u_right=(uv[:, 0] - disparity).astype(np.float32),
            depth=depth.astype(np.float32),
            position_cam=camera.back_project(uv, depth).astype(np.float32),
            label=self.label[rows],
            instance_id=self.label[rows].astype(np.int32),
        )


def straight_drive(n: int = 40, start_m: float = 0.0, step_m: float = 0.8, x_m: float = 0.0) -> list[np.ndarray]:
    """Poses of a car that follows the street."""
    R = heading_to_rotation(0.0)
    return [make_pose(R, np.array([x_m, start_m + step_m * i, 0.0])) for i in range(n)]


def drive(slam: StereoSlam, street: Street, poses: list[np.ndarray], seed: int = 1000) -> list[TrackedFrame]:
    """Track every pose's view."""
    frames = [slam.track(street.see(T, seed + i), 0.1 * i, i) for i, T in enumerate(poses)]
    slam.finish()
    return frames


def stored_map(slam: StereoSlam) -> FeatureMap:
    """The landmarks of a drive as a stored map."""
    store = slam.landmarks
    good = store.n_found >= 3
    n = int(good.sum())
    return FeatureMap(
        MapFeatures(
            id=np.arange(1, n + 1, dtype=np.uint64),
            position=store.position[good],
            descriptor=store.descriptor[good],
            normal=store.normal[good],
            min_distance=store.min_distance[good],
            max_distance=store.max_distance[good],
            label=store.label[good],
            instance_key=np.zeros(n, np.uint64),
            first_seen=store.first_seen[good],
            last_seen=store.last_seen[good],
            observations=store.n_found[good].astype(np.uint16),
        )
    )
