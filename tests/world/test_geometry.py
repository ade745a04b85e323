"""Cameras, poses and the Earth: known geometry in, known answer out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autowaze.world.camera import StereoCamera
from autowaze.world.errors import AutowazeError
from autowaze.world.georeference import Georeference
from autowaze.world.pose import heading_of, heading_to_rotation, inverse, make_pose, so3_exp, so3_log, transform

CAMERA = StereoCamera(720.0, 710.0, 610.0, 173.0, 0.54, 1242, 375)
coordinates = st.floats(-50, 50)


def test_a_point_ahead_projects_to_the_principal_point_with_its_disparity() -> None:
    u, v, u_right = CAMERA.project(np.array([[0.0, 0.0, 10.0]]))[0]
    assert (u, v, u - u_right) == pytest.approx((610.0, 173.0, 720.0 * 0.54 / 10.0))


@given(coordinates, coordinates, st.floats(1, 80))
def test_back_projection_undoes_projection(x: float, y: float, z: float) -> None:
    point = np.array([[x, y, z]])
    uv = CAMERA.project(point)[:, :2]
    np.testing.assert_allclose(CAMERA.back_project(uv, point[:, 2]), point, atol=1e-9)


def test_a_scaled_camera_sees_the_same_pixel_scaled() -> None:
    half = CAMERA.scaled(0.5)
    point = np.array([[3.0, 1.0, 12.0]])
    full, scaled = CAMERA.project(point)[0], half.project(point)[0]
    assert (scaled[0] + 0.5) / half.width == pytest.approx((full[0] + 0.5) / CAMERA.width)


def test_an_impossible_calibration_is_refused() -> None:
    with pytest.raises(AutowazeError, match="calibration"):
        StereoCamera(720.0, 710.0, 610.0, 173.0, -0.54, 1242, 375)


@given(st.floats(-3.1, 3.1))
def test_a_camera_looks_along_its_heading(heading: float) -> None:
    T = make_pose(heading_to_rotation(heading), np.array([5.0, 6.0, 7.0]))
    ahead = transform(T, np.array([[0.0, 0.0, 10.0]]))[0] - [5.0, 6.0, 7.0]
    np.testing.assert_allclose(ahead, [10 * np.sin(heading), 10 * np.cos(heading), 0.0], atol=1e-12)
    assert heading_of(T) == pytest.approx(heading)
    below = transform(T, np.array([[0.0, 2.0, 0.0]]))[0]
    assert below[2] == pytest.approx(5.0)  # the camera's y points down


@given(st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_rotation_vectors_survive_the_exponential(omega: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(so3_log(so3_exp(np.array(omega))), omega, atol=1e-9)


def test_inverses_of_a_stack_of_poses() -> None:
    stack = np.stack([make_pose(so3_exp(np.array([0.1, 0.2, i])), np.array([i, 2.0, 3.0])) for i in range(4)])
    np.testing.assert_allclose(inverse(stack) @ stack, np.tile(np.eye(4), (4, 1, 1)), atol=1e-12)


def test_a_hundred_metres_north_on_the_ellipsoid() -> None:
    here = Georeference(49.0, 8.4, 110.0)
    degrees = 100.0 / 111_200.0  # a degree of latitude at 49 north is 111.2 km (WGS84)
    east, north, up = here.to_map(np.array([[8.4, 49.0 + degrees]]))[0]
    assert (east, north) == (pytest.approx(0.0, abs=1e-6), pytest.approx(100.0, abs=0.05))
    assert abs(up) < 0.01
    np.testing.assert_allclose(here.to_lon_lat(np.array([[east, north]])), [[8.4, 49.0 + degrees]], atol=1e-9)


def test_a_place_has_its_coordinates_in_every_map_frame() -> None:
    here, there = Georeference(43.0845, -77.6749, 150.0), Georeference(43.0862, -77.6715, 163.0)
    lon_lat = np.array([[-77.6722, 43.0851], [-77.6730, 43.0870]])
    moved = transform(here.pose_of(there), there.to_map(lon_lat, 171.0))
    np.testing.assert_allclose(moved, here.to_map(lon_lat, 171.0), atol=1e-5)
