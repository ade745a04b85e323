"""Diffs with random content, for round trips."""

import numpy as np

from autowaze.world.feature_map import MapFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.ground import GroundCells
from autowaze.world.identity import feature_ids, instance_keys
from autowaze.world.map_diff import InstanceSummaries, SemanticMapDiff, Traffic, Trajectory


def random_features(rng: np.random.Generator, count: int, session: int, sequence: int, start: float) -> MapFeatures:
    normal = rng.normal(size=(count, 3)).astype(np.float32)
    described = rng.random(count) < 0.6
    near = rng.uniform(0.5, 20, count).astype(np.float32)
    return MapFeatures(
        id=feature_ids(session, sequence, count),
        position=np.round(rng.normal(scale=80, size=(count, 3)), 2),
        descriptor=rng.integers(1, 256, (count, 32), dtype=np.uint8) * described[:, None],
        normal=(normal / np.linalg.norm(normal, axis=1, keepdims=True)) * described[:, None],
        min_distance=near * described,
        max_distance=4 * near * described,
        label=rng.integers(0, 10, count).astype(np.uint8),
        instance_key=instance_keys(session, rng.integers(0, 50, count)),
        first_seen=start + np.round(rng.uniform(0, 5, count), 1),
        last_seen=start + np.round(rng.uniform(0, 5, count), 1),
        observations=rng.integers(1, 60, count).astype(np.uint16),
    )


def random_diff(
    seed: int, features: int = 200, cells: int = 300, session: int = 12345, sequence: int = 7
) -> SemanticMapDiff:
    rng = np.random.default_rng(seed)
    start = 1.7e9 + float(rng.integers(0, 1000))
    angle = rng.uniform(-np.pi, np.pi, 9)
    flat = np.unique(rng.integers(0, 200 * 200, cells))
    return SemanticMapDiff(
        session=session,
        sequence=sequence,
        start=start,
        end=start + 5.0,
        map_version=3,
        georeference=Georeference(49.0, 8.4, 113.0),
        frames=50,
        localized_frames=48,
        position_sigma_m=0.031,
        new=random_features(rng, features, session, sequence, start),
        removed=np.unique(rng.integers(1, 1 << 62, 40, dtype=np.uint64)),
        instances=InstanceSummaries(
            id=np.arange(1, 10, dtype=np.int32),
            label=rng.integers(1, 4, 9).astype(np.uint8),
            confidence=rng.random(9).astype(np.float32),
            view_direction=np.stack([np.sin(angle), np.cos(angle)], axis=1).astype(np.float32),
            frames=rng.integers(1, 50, 9).astype(np.uint16),
        ),
        ground=GroundCells(
            ix=(flat % 200 - 100).astype(np.int32),
            iy=(flat // 200 - 100).astype(np.int32),
            free=(flat % 3 > 0).astype(np.uint16),
            obstacle=(flat % 3 == 0).astype(np.uint16),
        ),
        traffic=Traffic(
            id=np.array([4, 11], dtype=np.int32),
            label=np.array([1, 5], dtype=np.uint8),
            position=rng.normal(scale=30, size=(2, 2)).astype(np.float32),
            velocity=rng.normal(scale=8, size=(2, 2)).astype(np.float32),
        ),
        trajectory=Trajectory(
            time=start + np.arange(5.0),
            position=np.round(rng.normal(scale=50, size=(5, 3)), 2),
            heading=rng.uniform(-3, 3, 5).astype(np.float32),
        ),
    )
