"""Where trees, lamps, signs, bins and the rest stand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from shapely import Point

from autowaze.simulator.description import StreetDescription
from autowaze.simulator.mesh import planted
from autowaze.simulator.plan.roads import Road
from autowaze.simulator.plan.street_plan import DRIVEWAY_M, StreetPlan
from autowaze.simulator.scene import Scene, Thing
from autowaze.simulator.things import furniture
from autowaze.simulator.things.ground import KERB_M
from autowaze.simulator.things.trees import TREE_SHAPES, tree

_KERB_CLEARANCE_M = 0.55
_WALL_CLEARANCE_M = 0.55


def furnish(scene: Scene, plan: StreetPlan, description: StreetDescription, rng: np.random.Generator) -> None:
    """Set up everything that stands on the pavements."""
    _add_models(scene, rng)
    for road in plan.roads:
        for side in (1, -1):
            if road.pavement_m > 0:
                _along_kerb(scene, plan, road, side, description, rng)
                _along_walls(scene, plan, road, side, description, rng)
    if description.layout == "lot":
        _around_car_park(scene, plan, description, rng)


def _add_models(scene: Scene, rng: np.random.Generator) -> None:
    for i in range(TREE_SHAPES):
        scene.models[f"tree-{i}"] = tree(rng)
    scene.models["lamp"] = furniture.lamp()
    for kind in furniture.SIGN_CELLS:
        scene.models[f"sign {kind}"] = furniture.sign(kind)
    for name in ("bin_on_wheels", "litter_bin", "bollard", "cone", "barrier", "cabinet", "bench"):
        scene.models[name] = getattr(furniture, name)()


def _place(
    scene: Scene,
    plan: StreetPlan,
    model: str,
    at: NDArray[np.float64],
    heading: float,
    scale: float = 1.0,
    tint: tuple[int, int, int] = (255, 255, 255),
) -> None:
    """Put a thing on the pavement; what would stand in the road is left out."""
    if plan.asphalt.buffer(0.25).contains(Point(at)):
        return
    scene.things.append(Thing(model, planted(float(at[0]), float(at[1]), KERB_M, heading, scale), tint))


def _free_of_driveways(road: Road, s: float, side: int) -> bool:
    return all(abs(s - d) > DRIVEWAY_M / 2 + 0.8 or side != on for d, on in road.driveways)


def _along_kerb(
    scene: Scene, plan: StreetPlan, road: Road, side: int, description: StreetDescription, rng: np.random.Generator
) -> None:
    """Trees, lamps, signs and bollards in a line close to the kerb."""
    offset = side * (road.kerb_m(side) + _KERB_CLEARANCE_M)
    # the kerb comes nearer where nobody parks, and so does what stands there
    s, slot = float(rng.uniform(2.0, 6.0)), int(rng.integers(0, 4))
    while s < road.centre.length - 2.0:
        at, towards_road = road.centre.beside(s, offset), float(road.centre.heading(s)) - side * np.pi / 2
        if _free_of_driveways(road, s, side):
            if slot % 4 == 0:
                _place(scene, plan, "lamp", at, towards_road)
            elif rng.random() < description.trees:
                _plant_tree(scene, plan, at, (0.75, 1.15), rng)
            elif rng.random() < description.clutter:
                facing_traffic = float(road.centre.heading(s)) + (np.pi / 2 if side > 0 else -np.pi / 2)
                kind = str(rng.choice(["sign parking", "sign parking", "sign speed", "litter_bin", "bollard"]))
                _place(scene, plan, kind, at, facing_traffic)
        s += float(rng.uniform(5.5, 7.5))
        slot += 1


def _along_walls(
    scene: Scene, plan: StreetPlan, road: Road, side: int, description: StreetDescription, rng: np.random.Generator
) -> None:
    """Bins, cabinets, benches and parked bicycles by the building line."""
    s = float(rng.uniform(1.0, 8.0))
    while s < road.centre.length - 1.0:
        if rng.random() < description.clutter and _free_of_driveways(road, s, side):
            at = road.centre.beside(s, side * (road.building_line_m(side) - _WALL_CLEARANCE_M))
            towards_road = float(road.centre.heading(s)) - side * np.pi / 2
            kind = str(rng.choice(["bin_on_wheels", "bin_on_wheels", "cabinet", "bench"]))
            if kind == "bin_on_wheels":
                for i in range(int(rng.integers(1, 4))):
                    tint = [(62, 66, 64), (52, 84, 58), (58, 66, 110), (150, 120, 40)][int(rng.integers(0, 4))]
                    beside = road.centre.beside(s + 0.72 * i, side * (road.building_line_m(side) - _WALL_CLEARANCE_M))
                    _place(scene, plan, kind, beside, towards_road + np.pi / 2 + float(rng.normal(0, 0.12)), tint=tint)
            else:
                _place(scene, plan, kind, at, towards_road + np.pi / 2)
        s += float(rng.uniform(5.0, 12.0))


def _plant_tree(
    scene: Scene, plan: StreetPlan, at: NDArray[np.float64], sizes: tuple[float, float], rng: np.random.Generator
) -> None:
    """A tree of any shape, turned any way, of a relative size between the two."""
    kind, turned = f"tree-{int(rng.integers(0, TREE_SHAPES))}", float(rng.uniform(0, 6.28))
    _place(scene, plan, kind, at, turned, float(rng.uniform(*sizes)))


def _around_car_park(scene: Scene, plan: StreetPlan, description: StreetDescription, rng: np.random.Generator) -> None:
    ring = np.array(plan.asphalt.buffer(1.1, join_style="mitre").exterior.coords)
    for a, b in pairwise(ring):
        length = float(np.linalg.norm(b - a))
        for slot, s in enumerate(np.arange(4.0, length - 2.0, 6.0)):
            at = a + (b - a) * (s + rng.normal(0, 0.4)) / length
            inwards = float(np.arctan2(*(np.array(plan.asphalt.centroid.coords[0]) - at)[::-1]))
            if slot % 4 == 1:
                _place(scene, plan, "lamp", at, inwards)
            elif rng.random() < description.trees:
                _plant_tree(scene, plan, at, (0.7, 1.0), rng)
