"""Which features of a map are kept."""

import numpy as np
import pytest

from autowaze.evaluation.map_selection import worth_keeping
from autowaze.evaluation.street_map import map_streets
from autowaze.vehicle.semantics.no_segmentation import NoSegmentation
from autowaze.world.camera import StereoCamera
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap
from autowaze.world.pose import heading_to_rotation, make_pose

CAMERA = StereoCamera(fx=700.0, fy=700.0, cx=620.0, cy=180.0, baseline_m=0.54, width=1240, height=370)
DRIVE = np.stack([make_pose(heading_to_rotation(0.0), np.array([0.0, 0.5 * i, 0.0])) for i in range(161)])  # 80 m north


def features(n: int, along: tuple[float, float], observations: int, described: bool = True) -> MapFeatures:
    """House fronts on both sides, seen from 20 m before them."""
    rng = np.random.default_rng(n)
    side = rng.choice([-1.0, 1.0], n)
    position = np.column_stack([8.0 * side, rng.uniform(*along, n), rng.uniform(-1.0, 4.0, n)])
    back = np.column_stack([-8.0 * side, np.full(n, -20.0), -position[:, 2]])
    empty = MapFeatures.empty()
    return MapFeatures(
        id=np.arange(1, n + 1, dtype=np.uint64),
        position=position,
        descriptor=np.full((n, 32), 7 if described else 0, np.uint8),
        normal=(back / np.linalg.norm(back, axis=1, keepdims=True)).astype(np.float32),
        min_distance=np.full(n, 5.0, np.float32),
        max_distance=np.full(n, 50.0, np.float32),
        label=np.zeros(n, np.uint8),
        instance_key=np.zeros(n, np.uint64),
        first_seen=np.zeros(n),
        last_seen=np.zeros(n),
        observations=np.full(n, observations, empty.observations.dtype),
    )


def test_a_map_that_is_small_enough_stays_whole() -> None:
    assert worth_keeping(features(400, (10.0, 90.0), 4), DRIVE, CAMERA, per_metre=10.0).all()


def test_plain_features_stay_and_described_ones_keep_to_the_room() -> None:
    both = MapFeatures.concatenate([features(3000, (10.0, 90.0), 4), features(500, (10.0, 90.0), 4, described=False)])
    keep = worth_keeping(both, DRIVE, CAMERA, per_metre=10.0)
    assert keep[3000:].all()
    assert 0.95 * 800 <= np.count_nonzero(keep[:3000]) <= 1.05 * 820


def test_what_is_found_more_often_is_kept() -> None:
    often, rarely = features(1000, (10.0, 90.0), 20), features(1000, (10.0, 90.0), 2)
    keep = worth_keeping(MapFeatures.concatenate([often, rarely]), DRIVE, CAMERA, per_metre=10.0)
    assert np.count_nonzero(keep[:1000]) > 5 * np.count_nonzero(keep[1000:])


def test_a_crowded_front_does_not_starve_the_rest_of_the_street() -> None:
    """The most observed features all lie on one front; the far end still keeps most of what little it has."""
    crowd, rest = features(4000, (20.0, 24.0), 12), features(200, (50.0, 90.0), 6)
    keep = worth_keeping(MapFeatures.concatenate([crowd, rest]), DRIVE, CAMERA, per_metre=10.0)
    assert np.mean(keep[4000:]) > 0.9


def test_a_map_in_another_frame_is_not_extended() -> None:
    known = FeatureMap(features(10, (0.0, 5.0), 3), Georeference(40.0, -73.0))
    with pytest.raises(AutowazeError, match="map frames"):
        map_streets([], NoSegmentation(), ParkingMap((), Georeference(41.0, -73.0)), known=known)
