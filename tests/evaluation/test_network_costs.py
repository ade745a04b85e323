"""Bytes up by content, and what a car that follows the map would fetch."""

from dataclasses import replace

import numpy as np
import pytest
from diffs import random_diff

from autowaze.cloud.service import CloudService
from autowaze.evaluation.drive import DriveRecord
from autowaze.evaluation.network import CONTENTS, TileFetches, content_bytes, content_metrics, network_metrics
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.ground import GroundCells
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.pose import make_pose
from autowaze.world.wire import encode_diff


def small_diff(sequence: int = 0, **changes: object) -> SemanticMapDiff:
    """A diff with features near the path, so that all lie in the tiles around it."""
    diff = random_diff(sequence, features=80, sequence=sequence)
    nothing_gone = np.zeros(0, np.uint64)
    return replace(diff, start=1.7e9 + 10 * sequence, end=1.7e9 + 10 * sequence + 5, removed=nothing_gone, **changes)


def driven(messages: list[bytes], diffs: list[SemanticMapDiff], metres: float) -> DriveRecord:
    none = np.zeros(0, np.int64)
    tracked = [
        TrackedFrame(
            0, 0.0, TrackingState.LOCALIZED, "", make_pose(np.eye(3), np.array([x, 0, 0])), np.eye(6), 9, 9, none, none
        )
        for x in (0.0, metres)
    ]
    return DriveRecord(tracked=tracked, diffs=diffs, messages=messages)


@pytest.mark.parametrize("seed", range(5))
def test_contents_add_up_to_the_message(seed):
    message = encode_diff(random_diff(seed))
    shares = content_bytes(message)
    assert tuple(shares) == CONTENTS
    assert sum(shares.values()) == pytest.approx(len(message))
    assert all(size >= 0 for size in shares.values())


def test_what_is_left_out_costs_nothing_and_only_that():
    whole = random_diff(1)
    shares = content_bytes(encode_diff(whole))
    message = encode_diff(replace(whole, new=MapFeatures.empty(), ground=GroundCells.empty()))
    without = content_bytes(message)
    assert shares["features"] > 0.5 * sum(shares.values())
    assert without["features"] < 20 and without["ground"] < 20
    assert shares["features"] - without["features"] == pytest.approx(shares["features"], rel=0.05)
    for name in ("removals", "instances", "trajectory"):
        assert without[name] == pytest.approx(shares[name], rel=0.15)


def test_figures_are_per_diff_and_per_kilometre():
    diffs = [small_diff(0), small_diff(1)]
    messages = [encode_diff(diff) for diff in diffs]
    record = driven(messages, diffs, 500.0)
    sizes, total = network_metrics(record), content_metrics(record)
    assert sizes["bytes_per_km"] == pytest.approx(2 * sum(map(len, messages)))
    assert sum(total[f"{name}_bytes_per_km"] for name in CONTENTS) == pytest.approx(sizes["bytes_per_km"])
    assert total["features_bytes_per_km"] == pytest.approx(4 * total["features_bytes_per_diff"])
    assert content_metrics(driven([], [], 1.0)) == {}


def test_a_car_fetches_its_tiles_once_and_then_only_what_changed():
    first, second = small_diff(0), small_diff(1)
    here = ParkingMap((), first.georeference)
    stored = FeatureMap(random_diff(9, features=400, session=7).new, first.georeference, 1)
    stored.features.position[:, :2] = np.random.default_rng(2).uniform(-30, 30, (400, 2))
    fetches = TileFetches(CloudService(here, base_map=stored))
    fetches.begin(np.zeros(3))
    whole = fetches.first_bytes
    assert whole > 400 * 32 * 0.8  # descriptors hardly compress
    messages = [encode_diff(diff) for diff in (first, first, second)]
    for message in messages:
        fetches.receive(message)
    changed, repeated, changed_again = fetches.update_bytes
    assert repeated == 0
    assert 0 < changed < whole and 0 < changed_again < whole
    record = driven(messages, [first, first, second], 1000.0)
    found = fetches.metrics(record)
    assert found["down_bytes_per_km"] == pytest.approx(sum(fetches.update_bytes) + sum(fetches.spot_bytes))
