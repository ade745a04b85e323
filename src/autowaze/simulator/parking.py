"""Who parks where, and how badly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.description import Parking
from autowaze.simulator.mesh import planted
from autowaze.simulator.plan.roads import Bay
from autowaze.simulator.scene import Model, Scene, Surface, Thing
from autowaze.simulator.things.car_shapes import SHAPES, SHARES
from autowaze.simulator.things.cars import car_model, paint_colour
from autowaze.world.errors import AutowazeError
from autowaze.world.labels import ClassLabel

STYLES = 3
"""How many makes of each body kind a street knows."""
CAR_GLOSS = 0.85


@dataclass(frozen=True)
class ParkedCar:
    """A car in a spot."""

    thing: Thing
    bay: Bay


def draw_car(scene: Scene, kinds: tuple[str, ...], styles_seed: int, rng: np.random.Generator, id: int) -> Thing:
    """A car at the origin; its model is added to the scene when it is new there."""
    shares = np.array([SHARES[kind] for kind in kinds])
    kind = str(rng.choice(list(kinds), p=shares / shares.sum()))
    model = car_model(kind, 1000 * styles_seed + int(rng.integers(0, STYLES)))
    if model.name not in scene.models:
        scene.surfaces[model.name] = Surface(model.texture, gloss=CAR_GLOSS)
        scene.models[model.name] = Model(((model.near, model.name),), ((model.far, model.name),))
    scale = float(rng.uniform(0.975, 1.025))
    shape = model.shape
    # mirrors do not count towards the width, as in every data set of vehicle boxes
    size = (
        scale * (shape.length + 0.09),
        scale * max(shape.width, shape.cargo[1] if shape.cargo else 0.0),
        scale * shape.overall_height,
    )
    label = ClassLabel.TRUCK if kind == "truck" else ClassLabel.CAR
    return Thing(model.name, planted(0, 0, 0, 0, scale), paint_colour(rng, kind), id, label, size, kind)


def park_cars(
    scene: Scene, bays: tuple[Bay, ...], parking: Parking, seed: int, rng: np.random.Generator, first_id: int
) -> list[ParkedCar]:
    """Fill the bays; every choice is drawn for every bay, so that one vacancy more changes no other car."""
    unknown = set(parking.vacant) - {bay.id for bay in bays}
    if unknown:
        raise AutowazeError(
            f"parking.vacant: no spot {', '.join(sorted(unknown))}; this street has {', '.join(b.id for b in bays)}"
        )
    if not parking.kinds:
        raise AutowazeError("parking.kinds: name at least one kind of car")
    taken = rng.permutation(len(bays)) < round(parking.occupancy * len(bays))
    cars = []
    for number, bay in enumerate(bays):
        own = np.random.default_rng(rng.integers(0, 2**63))
        if not taken[number] or bay.id in parking.vacant:
            continue
        fitting = tuple(
            k for k in parking.kinds if SHAPES[k].length < bay.length_m + (0.1 if bay.kind == "parallel" else 0.9)
        )
        car = draw_car(scene, fitting or parking.kinds, seed, own, first_id + number)
        cars.append(ParkedCar(car.moved_to(_parked_pose(bay, car, parking.sloppiness, own)), bay))
    return cars


def _parked_pose(bay: Bay, car: Thing, sloppiness: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Where the car comes to stand: off the middle, a little askew, rarely over the line."""
    bad = rng.random() < 0.06 * sloppiness
    spread = sloppiness * (2.2 if bad else 1.0)
    room = max(bay.length_m - car.size[0], 0.0)
    along = float(np.clip(rng.normal(0, 0.22 * spread), -room / 2 - 0.15 * spread, room / 2 + 0.15 * spread))
    across = float(rng.normal(0, (0.10 if bay.kind == "parallel" else 0.14) * spread))
    askew = float(rng.normal(0, np.radians(1.4 if bay.kind == "parallel" else 2.0) * spread))
    heading = bay.heading_rad + askew
    if bay.kind == "parallel":
        # most keep close to the kerb, which lies to the right of the direction of travel
        across -= max(0.0, (bay.width_m - car.size[1]) / 2 - 0.12)
    elif bay.kind == "perpendicular" and rng.random() < 0.3:
        heading += np.pi
    direction = np.array([np.cos(bay.heading_rad), np.sin(bay.heading_rad)])
    left = np.array([-direction[1], direction[0]])
    at = bay.centre + along * direction + across * left
    return planted(float(at[0]), float(at[1]), 0.0, heading)


def contact_shadow(thing: Thing) -> Thing:
    """The dark patch under a car."""
    T = thing.T_map_thing.copy()
    scale = np.linalg.norm(T[:3, 0])
    T[:3, :3] /= scale
    T[:3, 0] *= thing.size[0] / 2 + 0.16
    T[:3, 1] *= thing.size[1] / 2 + 0.16
    T[2, 3] += 0.018
    return Thing("contact-shadow", T)
