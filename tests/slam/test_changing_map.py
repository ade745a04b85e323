"""The stored map changes under a car that drives."""

import numpy as np
import pytest
from known_street import CAMERA, Street, drive, stored_map, straight_drive

from autowaze.evaluation.drive import run_drive
from autowaze.vehicle.diffing import DiffSettings
from autowaze.vehicle.downlink import Arrivals, RecordedDownlink
from autowaze.vehicle.node import NodeSettings, StartingPoint, VehicleNode
from autowaze.vehicle.semantics.no_segmentation import NoSegmentation
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackingState
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.features import CameraFeatures
from autowaze.world.frame import StereoFrame
from autowaze.world.georeference import Georeference
from autowaze.world.identity import feature_ids
from autowaze.world.map_update import MapUpdate

NONE = np.zeros(0, np.uint64)
GEOREFERENCE = Georeference(40.0, -73.0)
POSES = straight_drive(70)


@pytest.fixture(scope="module")
def surveyed():
    """A street and its map, in two halves."""
    street = Street()
    slam = StereoSlam(CAMERA, T_map_start=POSES[0])
    drive(slam, street, POSES)
    features = stored_map(slam).features
    is_near = features.position[:, 1] < 30.0
    return street, features[is_near], features[~is_near]


def states(frames):
    return [frame.state for frame in frames]


def test_what_comes_down_is_localised_in(surveyed):
    street, near, far = surveyed
    slam = StereoSlam(CAMERA, stored_map=FeatureMap(near), T_map_start=POSES[0])
    localized = []
    for i, T in enumerate(POSES):
        if i == 20:
            slam.replace_stored_features(far, NONE)
        frame = slam.track(street.see(T, 5000 + i), 0.1 * i, i)
        localized.append(frame.state is TrackingState.LOCALIZED)
        assert np.linalg.norm(frame.T_map_cam[:3, 3] - T[:3, 3]) < 0.3
    slam.finish()
    assert all(localized)


def test_what_is_taken_out_is_localised_in_no_more_and_can_come_back(surveyed):
    street, near, far = surveyed
    slam = StereoSlam(CAMERA, stored_map=FeatureMap(MapFeatures.concatenate([near, far])), T_map_start=POSES[0])
    seen = []
    for i, T in enumerate(POSES):
        if i == 20:
            slam.replace_stored_features(MapFeatures.empty(), np.concatenate([near.id, far.id]))
            assert not slam.landmarks.is_stored.any()
        if i == 40:
            slam.replace_stored_features(MapFeatures.concatenate([near, far]), NONE)
        seen.append(slam.track(street.see(T, 5000 + i), 0.1 * i, i))
        assert np.linalg.norm(seen[-1].T_map_cam[:3, 3] - T[:3, 3]) < 0.3
    slam.finish()
    assert TrackingState.LOST not in states(seen)
    assert {*states(seen[20:40])} == {TrackingState.ODOMETRY}
    assert {*states(seen[46:])} == {TrackingState.LOCALIZED}


def test_the_same_features_again_change_nothing(surveyed):
    street, near, _ = surveyed
    slam = StereoSlam(CAMERA, stored_map=FeatureMap(near), T_map_start=POSES[0])
    drive(slam, street, POSES[:10])
    slam.replace_stored_features(near, NONE)
    assert np.count_nonzero(slam.landmarks.is_stored) == len(near)


class Sight:
    """Extracts what would be seen of the street."""

    def __init__(self, street):
        self.street = street

    def extract(self, frame):
        return self.street.see(POSES[frame.index], 7000 + frame.index)


class Trace(list):
    name, camera, ground_truth = "street", CAMERA, None


def frames():
    blank = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    return Trace(StereoFrame(i, 1000.0 + 0.1 * i, blank, blank) for i in range(len(POSES)))


def node(street, stored, session=5, extractor=None, ground_every=20):
    settings = NodeSettings(diff=DiffSettings(window_s=1.0), ground_every=ground_every)
    start = StartingPoint(GEOREFERENCE, POSES[0])
    return VehicleNode(CAMERA, NoSegmentation(), settings, stored, start, session, extractor or Sight(street))


class Scheduled:
    """Comes down at the ends of these windows."""

    def __init__(self, updates):
        self.updates, self.window = updates, -1

    def arrivals(self, position_map):
        self.window += 1
        return Arrivals(self.updates.get(self.window))


def numbered(features, session):
    """As another car would have sent them."""
    features = features[:]
    features.id = feature_ids(session, 0, len(features))
    return features


@pytest.fixture(scope="module")
def halves(surveyed):
    street, near, far = surveyed
    return street, numbered(near[:4000], 1), numbered(far[:4000], 2)


def test_a_drive_depends_on_nothing_but_what_came_down_at_which_window(halves):
    street, near, far = halves
    stored = FeatureMap(near, GEOREFERENCE, 3)
    updates = {1: MapUpdate(3, 8, far, NONE), 4: MapUpdate(8, 9, MapFeatures.empty(), near.id[:50])}
    first = run_drive(frames(), node(street, stored), lambda message: None, downlink=Scheduled(updates))
    again = run_drive(
        frames(), node(street, stored), lambda message: None, downlink=RecordedDownlink(first.map_updates)
    )
    assert again.messages == first.messages
    assert [diff.map_version for diff in first.diffs] == [3, 3, 8, 8, 8, 9, 9]
    assert first.localized_fraction == 1.0
    alone = run_drive(frames(), node(street, stored), lambda message: None)
    assert alone.localized_fraction < 0.8
    assert sum(len(d.new) for d in first.diffs) < 0.5 * sum(len(d.new) for d in alone.diffs)


def test_a_car_leaves_out_what_it_sent_itself(halves):
    street, near, far = halves
    car = node(street, None, session=2)
    car.adopt(MapUpdate(0, 7, MapFeatures.concatenate([near, far]), NONE, GEOREFERENCE))
    assert car.stored_map.version == 7
    assert car.stored_map.features.id.tolist() == near.id.tolist()


def test_the_map_does_not_change_within_a_window(halves):
    street, near, far = halves
    car = node(street, FeatureMap(near, GEOREFERENCE, 3))
    car.process(frames()[0])
    before = car.stored_map
    with pytest.raises(AutowazeError, match="between two windows"):
        car.adopt(MapUpdate(3, 4, far, NONE))
    assert car.stored_map is before
    car.finish()


class Covered:
    """A camera that a leaf covers from the fourth frame on."""

    def __init__(self, street):
        self.sight = Sight(street)

    def extract(self, frame):
        return CameraFeatures.empty() if frame.index > 3 else self.sight.extract(frame)


def narrow(position):
    """The house fronts within a metre, so that what is missing is missing together."""
    position[:, 0] = np.sign(position[:, 0]) * (6.0 + (np.abs(position[:, 0]) - 6.0) / 6.0)


def test_a_window_that_is_not_sure_of_its_place_removes_nothing(halves):
    _, near, _ = halves
    near = near[:]
    near.position = near.position.copy()
    street, elsewhere, half_gone = Street(), Street(seed=99), Street()
    for position in (near.position, street.position, elsewhere.position, half_gone.position):
        narrow(position)
    half_gone.position[half_gone.position[:, 0] > 0.0, 1] += 500.0

    def removed(street, sight):
        car = node(street, FeatureMap(near, GEOREFERENCE, 3), extractor=sight(street), ground_every=1)
        diffs = [*map(car.process, frames()[:20]), car.finish()]
        return np.concatenate([NONE, *(diff.removed for diff in diffs if diff is not None)])

    gone = np.isin(near.id, removed(half_gone, Sight))
    assert np.count_nonzero(gone) > 100
    assert np.mean(near.position[gone, 0] > 0.0) > 0.95
    assert not len(removed(elsewhere, Sight))
    assert not len(removed(half_gone, Covered))
