import numpy as np
import pytest

from autowaze.simulator.mesh import Mesh
from autowaze.simulator.things.car_shapes import SHAPES
from autowaze.simulator.things.cars import car_model


def signed_volume(mesh: Mesh) -> float:
    a, b, c = (mesh.position[mesh.faces[:, i]].astype(float) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("kind", SHAPES)
def test_a_car_has_the_size_it_says_and_faces_outwards(kind: str) -> None:
    model = car_model(kind, 0)
    low, high = model.near.position.min(axis=0), model.near.position.max(axis=0)
    shape = model.shape
    assert high[0] - low[0] == pytest.approx(shape.length, abs=0.12)
    assert high[1] - low[1] == pytest.approx(shape.width + 0.35, abs=0.30)  # with mirrors
    assert high[2] == pytest.approx(shape.overall_height, abs=0.03)
    assert low[2] == pytest.approx(0.0, abs=0.01)
    assert signed_volume(model.near) > 0.4 * shape.length * shape.width * shape.height


@pytest.mark.parametrize("kind", SHAPES)
def test_the_far_car_fills_the_near_one(kind: str) -> None:
    model = car_model(kind, 0)
    assert len(model.far) < 0.5 * len(model.near)
    assert signed_volume(model.far) == pytest.approx(signed_volume(model.near), rel=0.12)


def test_wheel_arches_are_open() -> None:
    shape = SHAPES["hatch"]
    above_wheel = float(shape.lower_edge(np.array(shape.front_axle)))
    assert above_wheel > 2 * shape.wheel_radius
    assert float(shape.lower_edge(np.array(0.0))) == pytest.approx(shape.sill)


def test_styles_differ() -> None:
    one, other = car_model("sedan", 0), car_model("sedan", 1)
    assert one.shape != other.shape
    assert not np.array_equal(one.texture, other.texture)
