"""A parked bicycle is told of once, without what nobody localises by."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from autowaze.vehicle.diffing import DiffSettings, DiffWindow, FrameObservation
from autowaze.vehicle.semantics.motion import Motions
from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.camera import StereoCamera
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.features import CameraFeatures
from autowaze.world.instances import Tracks
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.pose import make_pose

CAMERA = StereoCamera(fx=700.0, fy=700.0, cx=320.0, cy=120.0, baseline_m=0.5, width=640, height=240)
BICYCLE = np.random.default_rng(7).uniform([-0.8, -0.3, 5.0], [0.8, 0.3, 5.4], (40, 3))
HOUSE = np.random.default_rng(8).uniform([4.0, -3.0, 8.0], [6.0, 3.0, 12.0], (40, 3))


def passed(places: NDArray[np.float64], label: ClassLabel, stored: MapFeatures | None = None) -> SemanticMapDiff:
    """The diff of a window whose frames find corners at these places, of one instance if that can move."""
    window = DiffWindow(CAMERA, 1, DiffSettings(), FeatureMap(stored) if stored is not None else None)
    landmarks, none = Landmarks(), CameraFeatures.empty()
    descriptor = np.full((len(places), 32), 85, np.uint8)
    ids = landmarks.add(position=places, descriptor=descriptor, label=np.full(len(places), label))
    nothing = np.zeros(0, np.int64)
    columns = {name: np.zeros((len(places), *column.shape[1:]), column.dtype) for name, column in vars(none).items()}
    for index in range(5):
        T = make_pose(np.eye(3), np.array([0.0, 0.0, 0.2 * index]))
        seen = (places - T[:3, 3]).astype(np.float32)
        columns |= {"depth": seen[:, 2], "position_cam": seen, "label": np.full(len(places), label, np.uint8)}
        columns["instance_id"] = np.full(len(places), 0 if label is ClassLabel.BACKGROUND else 3, np.int32)
        tracked = TrackedFrame(index, 0.1 * index, TrackingState.ODOMETRY, "", T, 1e-6 * np.eye(6), 40, 0, ids, nothing)
        tracks = Tracks.empty(CAMERA.height, CAMERA.width)
        window.add(FrameObservation(tracked, replace(none, **columns), tracks, Motions.empty(), None), landmarks)
    return window.close(landmarks)


def test_what_comes_and_goes_carries_no_descriptor() -> None:
    bicycle, house = passed(BICYCLE, ClassLabel.TWO_WHEELER), passed(HOUSE, ClassLabel.BACKGROUND)
    assert len(bicycle.new) == len(BICYCLE)
    assert len(house.new) > 10
    assert not bicycle.new.described.any()
    assert house.new.described.all()


@pytest.mark.parametrize(("aside_m", "is_news"), [(0.03, False), (4.0, True)])
def test_a_bicycle_that_the_map_holds_is_no_news(aside_m: float, is_news: bool) -> None:
    stored = passed(BICYCLE + np.array([aside_m, 0.0, 0.0]), ClassLabel.TWO_WHEELER).new
    assert bool(len(passed(BICYCLE, ClassLabel.TWO_WHEELER, stored).new)) == is_news
