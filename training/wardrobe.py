"""Everyone and everything that a training picture may show: car models, people, two-wheelers, clutter."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.mesh import Mesh, box
from autowaze.simulator.parking import CAR_GLOSS
from autowaze.simulator.scene import Model, Scene, Surface
from autowaze.simulator.things.cars import CarModel, car_model
from autowaze.simulator.things.people import rider, walker
from autowaze.simulator.things.two_wheelers import SADDLE_M, bicycle, motorcycle

_KINDS = ("city", "hatch", "hatch", "sedan", "estate", "suv", "suv", "minivan", "van", "pickup", "sports", "truck")
_FIRST_STYLE = 10_000_000  # presets number their makes from thousands: no training car is one of theirs
_MODELS_PER_STREET, _NEW_MODELS_PER_STREET = 26, 5
_WALKERS, _RIDERS, _CLUTTER_MODELS = 20, 5, 14
_CLUTTER_SURFACES = (
    "hedge", "plain", "metal", "garage", "roof", "bark", "windows", "shops", "wall-marks", "paving", "asphalt",
)  # fmt: skip

WALKERS = tuple(f"walker-t{i}" for i in range(_WALKERS))
TWO_WHEELERS = ("bicycle-t", "motorcycle-t", *(f"cyclist-t{i}" for i in range(_RIDERS)))
CLUTTER = tuple(f"clutter-{i}" for i in range(_CLUTTER_MODELS))


class Wardrobe:
    """Car models that streets share, a few of them made new for every street: painting one takes a second."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._models: list[tuple[CarModel, Surface]] = []

    def pick(self) -> list[tuple[CarModel, Surface]]:
        """The models of the next street."""
        new = _NEW_MODELS_PER_STREET if len(self._models) >= _MODELS_PER_STREET else 12
        for _ in range(new):
            kind = str(self._rng.choice(_KINDS))
            model = car_model.__wrapped__(kind, int(self._rng.integers(_FIRST_STYLE, 2**31)))
            self._models.append((model, Surface(_worn(model.texture, self._rng), gloss=_gloss(self._rng))))
        self._models = self._models[-90:]
        chosen = self._rng.permutation(len(self._models))[:_MODELS_PER_STREET]
        return [self._models[i] for i in chosen]


def _gloss(rng: np.random.Generator) -> float:
    return float(rng.choice([CAR_GLOSS, rng.uniform(0.0, 1.0)]))


def _worn(texture: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """The painted skin in another contrast, sometimes with dirt or lettering; the finish in alpha stays."""
    colour = texture[..., :3].astype(np.float32)
    colour = np.clip((colour - 128) * rng.uniform(0.75, 1.25) + 128 + rng.uniform(-20, 20), 0, 255)
    if rng.random() < 0.3:
        coarse = rng.normal(0, rng.uniform(5, 30), (12, 12)).astype(np.float32)
        colour += cv2.resize(coarse, colour.shape[1::-1], interpolation=cv2.INTER_CUBIC)[..., None]
    if rng.random() < 0.25:
        for _ in range(int(rng.integers(1, 12))):
            x, y = (int(v) for v in rng.integers(0, len(colour), 2))
            w, h = (int(v) for v in rng.integers(8, 120, 2))
            colour[y : y + h, x : x + w] = rng.uniform(0, 255)
    return np.dstack([np.clip(colour, 0, 255).astype(np.uint8), texture[..., 3]])


def add_models(scene: Scene, cars: list[tuple[CarModel, Surface]], rng: np.random.Generator) -> None:
    """Put the chosen cars, and new people and clutter, into a street."""
    for model, surface in cars:
        scene.surfaces[model.name] = surface
        scene.models[model.name] = Model(((model.near, model.name),), ((model.far, model.name),))
    for i in range(_WALKERS):
        scene.models[f"walker-t{i}"] = Model(((walker(int(rng.integers(0, 4000)), float(rng.random())), "plain"),))
    for i in range(_RIDERS):
        figure = Mesh.concatenate([bicycle(), rider(int(rng.integers(0, 4000)), SADDLE_M)])
        scene.models[f"cyclist-t{i}"] = Model(((figure, "plain"),))
    scene.models["bicycle-t"] = Model(((bicycle(), "plain"),))
    scene.models["motorcycle-t"] = Model(((motorcycle(), "metal"),))
    surfaces = [name for name in _CLUTTER_SURFACES if name in scene.surfaces and not scene.surfaces[name].decal]
    for i in range(_CLUTTER_MODELS):
        x, y, z = rng.uniform(0.3, 2.0), rng.uniform(0.1, 1.0), np.exp(rng.uniform(np.log(0.4), np.log(2.6)))
        solid = box((-x, -y, 0.0), (x, y, float(z)), float(rng.uniform(0.5, 2.0)))
        scene.models[f"clutter-{i}"] = Model(((solid, str(rng.choice(surfaces))),))
