"""A whole street, ready to be driven through: plan, scene, parked cars."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from functools import lru_cache

import numpy as np

from autowaze.simulator.description import StreetDescription
from autowaze.simulator.light import Illumination, illuminate
from autowaze.simulator.mesh import Mesh, quads
from autowaze.simulator.parking import ParkedCar, park_cars
from autowaze.simulator.plan.frontage import Building, build_frontages
from autowaze.simulator.plan.furnishing import furnish
from autowaze.simulator.plan.street_plan import StreetPlan, plan_street
from autowaze.simulator.scene import Model, Scene, Thing
from autowaze.simulator.surfaces.palette import street_surfaces
from autowaze.simulator.things.ground import add_ground

FIRST_PARKED_ID, FIRST_OTHER_ID, FIRST_MOVING_ID = 1, 1001, 2001
"""Instance ids: a parked car's is 1 plus the number of its spot, then what stands elsewhere, then what moves."""


@dataclass(frozen=True)
class Street:
    """A street as the seeds made it."""

    description: StreetDescription
    plan: StreetPlan
    light: Illumination
    scene: Scene
    parked: tuple[ParkedCar, ...]
    buildings: tuple[Building, ...]


@dataclass(frozen=True)
class _Setting:
    """What stays from drive to drive."""

    plan: StreetPlan
    ground: list[tuple[Mesh, str, bool]]
    things: list[Thing]
    models: dict[str, Model]
    buildings: tuple[Building, ...]


def build_street(description: StreetDescription) -> Street:
    """Build the street of a description."""
    setting = _setting(_permanent(description))
    light = illuminate(
        description.light,
        description.latitude,
        description.effects.exposure,
        np.random.default_rng([description.seed, description.drive, 3]),
    )
    autumn = date.fromisoformat(description.light.date).month in (10, 11) and description.latitude > 0
    scene = Scene(
        dict(street_surfaces(description.seed, light.night > 0.5, autumn)),
        dict(setting.models),
        list(setting.ground),
        list(setting.things),
    )
    whose = description.drive if description.parking.drive is None else description.parking.drive
    rng = np.random.default_rng([description.seed, whose, 4])
    parked = park_cars(scene, setting.plan.bays, description.parking, description.seed, rng, FIRST_PARKED_ID)
    return Street(description, setting.plan, light, scene, tuple(parked), setting.buildings)


def _permanent(description: StreetDescription) -> StreetDescription:
    """The description without what changes from drive to drive, as a key."""
    plain = StreetDescription()
    changing = {
        name: getattr(plain, name) for name in ("drive", "parking", "traffic", "light", "effects", "rig", "ego")
    }
    return description.model_copy(update=changing)


@lru_cache(maxsize=2)
def _setting(description: StreetDescription) -> _Setting:
    plan = plan_street(description)
    scene = Scene()
    rng = np.random.default_rng([description.seed, 5])
    add_ground(scene, plan, rng)
    buildings = build_frontages(scene, plan, rng)
    square = [[(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]]
    scene.models["contact-shadow"] = Model(((quads(square, [(0, 0), (1, 0), (1, 1), (0, 1)]), "contact-shadow"),))
    furnish(scene, plan, description, rng)
    return _Setting(plan, scene.ground, scene.things, scene.models, tuple(buildings))
