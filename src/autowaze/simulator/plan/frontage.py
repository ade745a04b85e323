"""What stands along the building lines: buildings in rows, houses behind hedges, walls where there is a gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from autowaze.simulator.mesh import Mesh, box, planted
from autowaze.simulator.plan.street_plan import StreetPlan, polygonal
from autowaze.simulator.scene import Scene
from autowaze.simulator.things.building_shell import draw_style
from autowaze.simulator.things.buildings import build
from autowaze.simulator.things.ground import KERB_M
from autowaze.simulator.things.trees import hedge

_SMALLEST_M = 5.0


@dataclass(frozen=True)
class Building:
    """A building as a map shows it.

    Attributes:
        outline: of its walls, map metres.
        height_m: from its foot to the top of the roof.
    """

    outline: Polygon
    height_m: float


def build_frontages(scene: Scene, plan: StreetPlan, rng: np.random.Generator) -> list[Building]:
    """Fill private ground along every frontage; returns the buildings."""
    buildings = []
    taken = polygonal(plan.asphalt.union(plan.pavement).buffer(-0.95))
    driveways = [
        road.centre.beside(s, side * road.building_line_m(side)) for road in plan.roads for s, side in road.driveways
    ]
    for frontage in plan.frontages:
        s, length = 0.0, frontage.line.length
        while s < length - _SMALLEST_M:
            house = frontage.kind == "houses"
            width = float(rng.uniform(9.0, 14.0) if house else rng.uniform(8.0, 15.0))
            setback = float(rng.uniform(3.0, 5.5)) if house else float(rng.choice([0.0, 0.0, 0.0, 0.4]))
            width = min(width, length - s)
            style = draw_style(rng, frontage.kind, width)
            footprint = _footprint(
                frontage.line.at(s), frontage.line.heading(s + width / 2), width, style.depth, setback
            )
            if footprint.intersects(taken):
                s += 1.5
                continue
            origin, heading = frontage.line.at(s), float(frontage.line.heading(s + width / 2))
            near_driveway = any(np.linalg.norm(frontage.line.at(s + width / 2) - d) < width / 2 for d in driveways)
            T = planted(origin[0], origin[1], KERB_M - 0.02, heading)
            back = T.copy()
            back[:2, 3] += setback * T[:2, 1]
            parts = build(style, rng, near_driveway)
            for mesh, surface, fine in parts:
                scene.add(mesh.moved(back), surface, fine)
            corners = [(0.0, 0.0), (width, 0.0), (width, style.depth), (0.0, style.depth)]
            outline = Polygon(np.array(corners) @ back[:2, :2].T + back[:2, 3])
            buildings.append(
                Building(outline, max(float(mesh.position[:, 2].max()) for mesh, _, _ in parts if len(mesh)))
            )
            if house:
                _garden(scene, T, width, setback, driveways, rng)
            taken = polygonal(taken.union(footprint.buffer(-0.05)))
            s += width + (float(rng.uniform(2.0, 4.5)) if house else 0.0)
    return buildings


def _footprint(
    origin: NDArray[np.float64], heading: NDArray[np.float64], width: float, depth: float, setback: float
) -> Polygon:
    along = np.array([np.cos(heading), np.sin(heading)])
    into = np.array([-along[1], along[0]])
    start = origin + 0.02 * along
    end = origin + (width - 0.02) * along
    # the whole lot counts, so that two streets do not share a garden
    near, far = 0.02 * into, (setback + depth) * into
    return Polygon([start + near, end + near, end + far, start + far])


def _garden(
    scene: Scene,
    T: NDArray[np.float64],
    width: float,
    setback: float,
    driveways: list[NDArray[np.float64]],
    rng: np.random.Generator,
) -> None:
    """A hedge, wall or fence towards the pavement with a gap for the path or the driveway."""
    style = str(rng.choice(["hedge", "wall", "low wall", "open"], p=[0.45, 0.2, 0.15, 0.2]))
    if style == "open":
        return
    gap = float(rng.uniform(0.3, 0.7)) * width
    gap_half = 0.7
    for driveway in driveways:
        local = (driveway - T[:2, 3]) @ T[:2, 0]
        if -1.0 < local < width + 1.0:
            gap, gap_half = float(local), 2.2
    for x0, x1 in ((0.0, gap - gap_half), (gap + gap_half, width)):
        if x1 - x0 < 0.5:
            continue
        if style == "hedge":
            height = float(rng.uniform(0.9, 1.7))
            scene.add(hedge(x0, x1, 0.15, 0.85, height, rng).moved(T), "hedge")
        else:
            height = 1.5 if style == "wall" else 0.7
            wall = [box((x0, 0.05, 0), (x1, 0.30, height), 3.2, (190, 170, 150, 255))]
            cap = box((x0 - 0.03, 0.02, height), (x1 + 0.03, 0.33, height + 0.07), 1.0, (215, 210, 200, 255))
            scene.add(Mesh.concatenate(wall).moved(T), "wall-brick")
            scene.add(cap.moved(T), "plain")
