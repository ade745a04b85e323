"""A kilometre of known street: how long its map takes to load, what it weighs, and an hour of driving in it.

The street is a ring of points with descriptors, so that a drive may last; frames are seen without images.
AUTOWAZE_BENCH_FRAMES shortens the hour.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackingState
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.features import CameraFeatures
from autowaze.world.identity import feature_ids
from autowaze.world.map_file import load_map, save_map
from autowaze.world.pose import heading_to_rotation, inverse, make_pose

CAMERA = StereoCamera(fx=721.5, fy=721.5, cx=609.6, cy=172.9, baseline_m=0.54, width=1242, height=375)
_LENGTH_M, _PER_METRE, _VEHICLE_POINTS_PER_METRE = 1000.0, 60, 14  # as surveys of simulated streets have them
_STEP_M, _FPS, _HOUR = 0.8, 10, 36_000
_SEEN_PER_FRAME, _SEEN_FROM_M = 500, 18.0
_REPORTS = 12


class RingStreet:
    """House fronts on both sides of a road that closes in itself."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        n = round(_LENGTH_M * _PER_METRE)
        self.along = np.sort(self._rng.uniform(0.0, _LENGTH_M, n))
        side = self._rng.choice([-1.0, 1.0], n) * self._rng.uniform(6.0, 12.0, n)
        self.position = _places(self.along, side, self._rng.uniform(-1.5, 5.0, n))
        self.descriptor = self._rng.integers(0, 256, (n, 32), dtype=np.uint8)
        self._flips = np.packbits(self._rng.random((4096, 256)) < 0.05, axis=1)

    def stored(self) -> FeatureMap:
        """Its map, with as many plain features of vehicles as streets have."""
        n, plain = len(self.position), round(_LENGTH_M * _VEHICLE_POINTS_PER_METRE)
        total = n + plain
        parked = _places(
            self._rng.uniform(0, _LENGTH_M, plain), np.full(plain, 4.0), self._rng.uniform(-1.5, 0.0, plain)
        )
        back = _places(self.along - _SEEN_FROM_M, np.zeros(n), np.zeros(n)) - self.position
        back /= np.linalg.norm(back, axis=1, keepdims=True)
        described = np.arange(total) < n
        ids = np.concatenate([feature_ids(1, k, 4096) for k in range(total // 4096 + 1)])[:total]
        return FeatureMap(
            MapFeatures(
                id=ids,
                position=np.concatenate([self.position, parked]),
                descriptor=np.concatenate([self.descriptor, np.zeros((plain, 32), np.uint8)]),
                normal=np.concatenate([back, np.zeros((plain, 3))]).astype(np.float32),
                min_distance=np.where(described, 3.0, 0.0).astype(np.float32),
                max_distance=np.where(described, 60.0, 0.0).astype(np.float32),
                label=np.where(described, 0, 1).astype(np.uint8),
                instance_key=np.where(described, 0, 1 + np.arange(total) // 100).astype(np.uint64),
                first_seen=np.full(total, 1.7e9),
                last_seen=np.full(total, 1.7e9),
                observations=np.full(total, 5, np.uint16),
            )
        )

    def pose(self, along_m: float) -> NDArray[np.float64]:
        """Of a car that follows the road."""
        centre = _places(np.array([along_m]), np.zeros(1), np.zeros(1))[0]
        return make_pose(heading_to_rotation(2 * np.pi * along_m / _LENGTH_M), centre)

    def see(self, along_m: float) -> CameraFeatures:
        """Some of the points ahead, with noise in pixels, disparity and descriptors."""
        near = np.flatnonzero(((self.along - along_m - 4.0) % _LENGTH_M) < 45.0)
        T = inverse(self.pose(along_m))
        points = self.position[near] @ T[:3, :3].T + T[:3, 3]
        pixel = CAMERA.project(np.where(points[:, 2:] > 5.0, points, [0.0, 0.0, -1.0]))
        seen = (points[:, 2] > 5.0) & (pixel[:, :2] > 0).all(axis=1)
        seen &= (pixel[:, 0] < CAMERA.width) & (pixel[:, 1] < CAMERA.height)
        rows = np.flatnonzero(seen)
        rows = np.sort(self._rng.permutation(rows)[:_SEEN_PER_FRAME])
        n = len(rows)
        uv = pixel[rows, :2] + self._rng.normal(0, 0.4, (n, 2))
        disparity = CAMERA.bf / points[rows, 2] + self._rng.normal(0, 0.2, n)
        depth = CAMERA.bf / disparity
        distance = np.linalg.norm(points[rows], axis=1)
        return CameraFeatures(
            uv=uv.astype(np.float32),
            octave=np.clip(np.ceil(np.log(60.0 / distance) / np.log(1.2)), 0, 7).astype(np.uint8),
            angle=np.zeros(n, np.float32),
            descriptor=self.descriptor[near[rows]] ^ self._flips[self._rng.integers(0, 4096, n)],
            u_right=(uv[:, 0] - disparity).astype(np.float32),
            depth=depth.astype(np.float32),
            position_cam=CAMERA.back_project(uv, depth).astype(np.float32),
            label=np.zeros(n, np.uint8),
            instance_id=np.zeros(n, np.int32),
        )


def run() -> None:
    frames, street = int(os.environ.get("AUTOWAZE_BENCH_FRAMES", _HOUR)), RingStreet()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ring.map"
        size = save_map(street.stored(), path)
        load_map(_tiny(street, Path(folder)))  # what numba compiled is loaded once
        before, start = resident_mb(), time.perf_counter()
        stored = load_map(path)
        seconds = time.perf_counter() - start
    described = FeatureMap(stored.features[stored.features.described])
    slam = StereoSlam(CAMERA, stored_map=described, position_prior=(street.pose(0.0)[:3, 3], 3.0))
    facts = Table("map of 1 km", "value")
    facts.add_row("features", f"{len(stored):,}")
    facts.add_row("file, MB", f"{size / 1e6:.2f}")
    facts.add_row("loading, s", f"{seconds:.3f}")
    facts.add_row("process, with SLAM on it, MB more", f"{resident_mb() - before:.0f}")
    Console(width=120).print(facts)
    Console(width=120).print(drive(slam, street, frames))


def _tiny(street: RingStreet, folder: Path) -> Path:
    save_map(FeatureMap(street.stored().features[:100]), folder / "tiny.map")
    return folder / "tiny.map"


def drive(slam: StereoSlam, street: RingStreet, frames: int) -> Table:
    """Round and round; a row for each twelfth of the way."""
    table = Table(
        "frames", "localised", "error median cm", "p95", "ms", "process MB", "landmarks", title="drive in a known map"
    )
    for part in np.array_split(np.arange(frames), _REPORTS):
        errors, localized, begin = [], 0, time.process_time()
        for i in part.tolist():
            along = (_STEP_M * i) % _LENGTH_M
            tracked = slam.track(street.see(along), 1.7e9 + i / _FPS, i)
            localized += tracked.state is TrackingState.LOCALIZED
            errors.append(np.linalg.norm(tracked.T_map_cam[:3, 3] - street.pose(along)[:3, 3]))
        table.add_row(
            f"{part[-1] + 1}",
            f"{localized / len(part):.4f}",
            f"{100 * np.median(errors):.1f}",
            f"{100 * np.percentile(errors, 95):.1f}",
            f"{1000 * (time.process_time() - begin) / len(part):.1f}",
            f"{resident_mb():.0f}",
            f"{len(slam.landmarks):,}",
        )
    slam.finish()
    return table


def resident_mb() -> float:
    """Memory of the process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _places(along: NDArray[np.float64], outside: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Map positions (N, 3): clockwise round the origin, beginning in the west, heading north."""
    turn, radius = 2 * np.pi * along / _LENGTH_M, _LENGTH_M / 2 / np.pi + outside
    return np.column_stack([-radius * np.cos(turn), radius * np.sin(turn), up])
