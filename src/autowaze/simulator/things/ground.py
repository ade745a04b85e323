"""Road, pavement, kerbs, markings and blemishes as meshes."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon

from autowaze.simulator.mesh import Mesh, quads
from autowaze.simulator.plan.roads import LANE_M, Bay, Road
from autowaze.simulator.plan.street_plan import DRIVEWAY_M, Area, StreetPlan, polygonal, site
from autowaze.simulator.scene import Scene
from autowaze.simulator.surfaces import ground as surface

KERB_M = 0.13
_PAINT_LIFT_M, _BLEMISH_LIFT_M = 0.012, 0.006
_LINE_M = 0.12

_BLEMISHES = (
    (surface.CRACKS, 0.50, (1.2, 3.2)),
    (surface.TAR, 0.12, (1.5, 3.5)),
    (surface.PATCHES, 0.14, (0.9, 2.6)),
    (surface.MANHOLES, 0.05, (0.62, 0.75)),
    (surface.OIL, 0.10, (0.4, 1.1)),
    (surface.LITTER, 0.09, (0.6, 1.6)),
)
"""Cells of the atlas, how common, and size in metres."""


def flat_mesh(
    area: Area, height_m: float, texture_m: float, tint: tuple[int, int, int, int] = (255, 255, 255, 255)
) -> Mesh:
    """A horizontal area, textured in map metres."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    if len(triangles) == 0:
        return Mesh.empty()
    corners = np.array([np.array(t.exterior.coords)[:3] for t in triangles])
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0
    corners[clockwise] = corners[clockwise][:, ::-1]
    flat = corners.reshape(-1, 2)
    position = np.column_stack([flat, np.full(len(flat), height_m)])
    return Mesh.of(position, (0.0, 0.0, 1.0), flat / texture_m, np.arange(len(flat)), tint)


def add_ground(scene: Scene, plan: StreetPlan, rng: np.random.Generator) -> None:
    """Everything horizontal, and the kerbs."""
    scene.add(flat_mesh(plan.asphalt, 0.0, surface.ASPHALT_M), "asphalt")
    scene.add(flat_mesh(plan.pavement, KERB_M, surface.PAVING_M), "paving")
    rest = polygonal(site(plan).difference(plan.asphalt).difference(plan.pavement))
    scene.add(flat_mesh(rest, KERB_M, surface.GRASS_M), "grass")
    lowered = [
        (plan.roads[r].centre.beside(s, side * plan.roads[r].kerb_m(side)))
        for r, road in enumerate(plan.roads)
        for s, side in road.driveways
    ]
    scene.add(_kerbs(plan.asphalt, lowered), "kerb")
    for road in plan.roads:
        for s, side in road.driveways:
            strip = road.strip(
                road.kerb_m(side) - 0.05, road.building_line_m(side), s - DRIVEWAY_M / 2, s + DRIVEWAY_M / 2, side
            )
            scene.add(
                flat_mesh(polygonal(strip.intersection(plan.pavement)), KERB_M + 0.004, surface.ASPHALT_M), "asphalt"
            )
    _add_markings(scene, plan)
    _add_blemishes(scene, plan, rng)


def _kerbs(asphalt: Area, lowered: list[NDArray[np.float64]]) -> Mesh:
    """The step up from the road, along every edge of it, rounded on top."""
    strips = []
    for polygon in getattr(asphalt, "geoms", [asphalt]):
        for number, ring in enumerate((polygon.exterior, *polygon.interiors)):
            line = np.array(shapely.segmentize(ring, 1.0).coords)
            # the road shall lie to the right: clockwise round its outside, the other way round a hole
            strips.append(_kerb_strip(line[::-1] if ring.is_ccw == (number == 0) else line, lowered))
    return Mesh.concatenate(strips)


def _kerb_strip(line: NDArray[np.float64], lowered: list[NDArray[np.float64]]) -> Mesh:
    step = np.diff(line, axis=0)
    length = np.linalg.norm(step, axis=1)
    keep = length > 1e-6
    a, b, step, length = line[:-1][keep], line[1:][keep], step[keep], length[keep]
    top = np.full(len(line), KERB_M + 0.003)
    for middle in lowered:
        away = np.linalg.norm(line - middle, axis=1)
        top = np.minimum(top, np.clip(0.02 + (away - DRIVEWAY_M / 2) * 0.15, 0.02, KERB_M + 0.003))
    za, zb = top[:-1][keep], top[1:][keep]
    outwards = np.stack([-step[:, 1], step[:, 0]], -1) / length[:, None]
    back_a, back_b = a + 0.13 * outwards, b + 0.13 * outwards
    s = np.concatenate([[0.0], np.cumsum(length)])

    def at(points: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([points, z])

    def strip_uv(near: float, far: float) -> NDArray[np.float64]:
        ends = [(s[:-1], near), (s[1:], near), (s[1:], far), (s[:-1], far)]
        return np.stack([np.stack([u, np.full(len(u), v)], -1) for u, v in ends], 1)

    zero = np.zeros(len(a))
    face = np.stack([at(a, zero), at(b, zero), at(b, zb), at(a, za)], 1)
    cap = np.stack([at(a, za), at(b, zb), at(back_b, zb), at(back_a, za)], 1)
    return quads(np.concatenate([face, cap]), np.concatenate([strip_uv(1.0, 0.6), strip_uv(0.55, 0.1)]))


def _add_markings(scene: Scene, plan: StreetPlan) -> None:
    painted: list[Polygon] = []
    junctions = _junctions(plan)
    for road in plan.roads:
        if road.pavement_m > 0:
            for s in np.arange(0.5, road.centre.length - 3.0, 6.0):
                dash = LineString(road.centre.part(s, s + 3.0).points).buffer(_LINE_M / 2, cap_style="flat")
                if not dash.intersects(junctions):
                    painted.append(dash)
    for bay in plan.bays:
        painted += _bay_lines(bay)
    for index, s in plan.crossings:
        painted += _zebra(plan.roads[index], s)
    painted += _stop_lines(plan)
    paint = shapely.union_all(painted).intersection(plan.asphalt)
    if not paint.is_empty:
        scene.add(flat_mesh(polygonal(paint), _PAINT_LIFT_M, 2.0), "marking")


def _junctions(plan: StreetPlan) -> Area:
    """Where roads overlap, with some room."""
    overlaps = [a.carriageway.intersection(b.carriageway) for i, a in enumerate(plan.roads) for b in plan.roads[:i]]
    return polygonal(shapely.union_all(overlaps).buffer(7.0))


def _bay_lines(bay: Bay) -> list[Polygon]:
    c = bay.corners
    edges = [(c[1], c[2]), (c[3], c[0])]
    if bay.kind == "parallel":
        edges = [(c[0], c[1]), (c[2], c[3]), (c[3], c[0])]
    return [LineString(edge).buffer(_LINE_M / 2 * 0.85, cap_style="square") for edge in edges]


def _zebra(road: Road, s: float) -> list[Polygon]:
    bars = []
    for left in np.arange(-LANE_M + 0.35, LANE_M - 0.1, 1.0):
        line = np.stack([road.centre.beside(s - 1.6, left), road.centre.beside(s + 1.6, left)])
        bars.append(LineString(line).buffer(0.24, cap_style="flat"))
    return bars


def _stop_lines(plan: StreetPlan) -> list[Polygon]:
    lines = []
    for index, s in plan.crossings:
        road = plan.roads[index]
        before = s < (road.allowed[0] + road.allowed[1]) / 2
        at, side = (s + 3.0, 1.0) if before else (s - 3.0, -1.0)
        points = np.stack([road.centre.beside(at, side * 0.2), road.centre.beside(at, side * (LANE_M - 0.1))])
        lines.append(LineString(points).buffer(0.18, cap_style="flat"))
    return lines


def _add_blemishes(scene: Scene, plan: StreetPlan, rng: np.random.Generator) -> None:
    """Cracks, patches and the like: no two stretches of road look alike."""
    x0, y0, x1, y1 = plan.asphalt.bounds
    shapely.prepare(plan.asphalt)
    count = int(plan.asphalt.area / 9.0)
    corners, uvs = [], []
    weights = np.array([w for _, w, _ in _BLEMISHES])
    for _ in range(count):
        at = rng.uniform((x0, y0), (x1, y1))
        cells, _, sizes = _BLEMISHES[int(rng.choice(len(_BLEMISHES), p=weights / weights.sum()))]
        size, angle = rng.uniform(*sizes), rng.uniform(0, 2 * np.pi)
        if cells in (surface.PATCHES, surface.MANHOLES):
            angle = plan.heading_rad + rng.normal(0, 0.05)
        stretch = rng.uniform(0.5, 1.6) if cells is surface.PATCHES else 1.0
        cell = surface.blemish_cell(int(rng.choice(list(cells))))
        if not shapely.contains(plan.asphalt, Point(at).buffer(size * 0.75)):
            continue
        axis = np.array([np.cos(angle), np.sin(angle)]) * size / 2
        across = np.array([-axis[1], axis[0]]) * stretch
        ring = [at - axis - across, at + axis - across, at + axis + across, at - axis + across]
        corners.append([(*p, _BLEMISH_LIFT_M) for p in ring])
        left, top, right, bottom = cell
        uvs.append([(left, bottom), (right, bottom), (right, top), (left, top)])
    if corners:
        scene.add(quads(corners, np.array(uvs)), "blemishes")
