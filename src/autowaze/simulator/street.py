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
from autowaze.simulator.plan.roads import Bay
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
    parked = _parked_cars(description, scene, setting.plan.bays)
    return Street(description, setting.plan, light, scene, tuple(parked), setting.buildings)


def _parked_cars(description: StreetDescription, scene: Scene, bays: tuple[Bay, ...]) -> list[ParkedCar]:
    """The cars of this drive, or those that another drive left, some of which have changed since."""
    parking, seed = description.parking, description.seed

    def cars_of(drive: int) -> list[ParkedCar]:
        return park_cars(scene, bays, parking, seed, np.random.default_rng([seed, drive, 4]), FIRST_PARKED_ID)

    if parking.drive is None:
        return cars_of(description.drive)
    order = np.random.default_rng([seed, description.drive, 6]).permutation(len(bays))
    changed = {bays[i].id for i in order[: round(parking.changed * len(bays))]}
    left = [car for car in cars_of(parking.drive) if car.bay.id not in changed]
    come = [car for car in cars_of(description.drive) if car.bay.id in changed] if changed else []
    return sorted([*left, *come], key=lambda car: car.thing.id)


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
