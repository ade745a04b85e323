"""What dense stereo says about the place of a stored feature."""

import numpy as np

from autowaze.vehicle.diffing.visibility import Sight, sight_of
from autowaze.world.camera import StereoCamera

CAMERA = StereoCamera(360.0, 360.0, 310.0, 93.0, 0.54, 621, 187)


def place(z: float) -> np.ndarray:
    return np.array([[0.0, 0.0, z]])


def sight_at(z: float, wall_m: float) -> Sight:
    depth = np.full((CAMERA.height, CAMERA.width), wall_m, np.float32)
    return Sight(int(sight_of(place(z), np.eye(4), depth, CAMERA)[0]))


def test_a_feature_on_the_wall_is_on_a_surface() -> None:
    assert sight_at(10.0, wall_m=10.1) is Sight.SURFACE


def test_a_wall_in_front_hides_a_feature() -> None:
    assert sight_at(10.0, wall_m=6.0) is Sight.HIDDEN


def test_one_sees_through_to_a_wall_behind() -> None:
    assert sight_at(10.0, wall_m=14.0) is Sight.THROUGH


def test_stereo_without_an_answer_knows_nothing() -> None:
    assert sight_at(10.0, wall_m=np.nan) is Sight.UNKNOWN


def test_far_away_stereo_cannot_tell_two_metres_apart() -> None:
    assert sight_at(30.0, wall_m=32.0) is Sight.SURFACE


def test_a_silhouette_edge_neither_hides_nor_shows_through() -> None:
    depth = np.full((CAMERA.height, CAMERA.width), 30.0, np.float32)
    depth[:, : int(CAMERA.cx) + 1] = 5.0  # the feature's four pixels straddle the edge
    assert sight_of(place(10.0), np.eye(4), depth, CAMERA)[0] == Sight.SURFACE


def test_out_of_view_is_no_evidence() -> None:
    depth = np.full((CAMERA.height, CAMERA.width), 30.0, np.float32)
    points = np.array([[0.0, 0.0, -5.0], [50.0, 0.0, 10.0]])
    assert (sight_of(points, np.eye(4), depth, CAMERA) == Sight.HIDDEN).all()
