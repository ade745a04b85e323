"""Car bodies lofted from a side profile through superellipse cross-sections, wheel arches cut out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.mesh import Mesh, grid_faces, shifted, vertex_normals
from autowaze.simulator.things.car_shapes import CarShape

NOSE_M, TAIL_M = 0.17, 0.11
"""How much of either end carries the paintings of front and rear."""

ATLAS_REGIONS = {"side": (0.0, 0.0, 1.0, 0.40), "top": (0.0, 0.40, 1.0, 0.74), "front": (0.0, 0.74, 0.4, 1.0),
                 "rear": (0.4, 0.74, 0.8, 1.0), "wheel": (0.8, 0.74, 1.0, 1.0)}  # fmt: skip
"""Left, top, right, bottom of what is painted where in a car's texture, as shares of its size."""

_UNDERSIDE, _SIDE, _GREENHOUSE = 3, 6, 10
_FLAT_GLASS_G = 2.6


@dataclass(frozen=True)
class Loft:
    """A body as a grid of cross-sections.

    Attributes:
        x: (S,) positions of the sections from rear to front.
        half: (S, K, 2) half sections as y, z from the middle of the underside to the middle of the roof.
        corner: index in a half section of the edge between the side windows and the roof.
    """

    shape: CarShape
    x: NDArray[np.float64]
    half: NDArray[np.float64]
    corner: int

    @property
    def window_top(self) -> NDArray[np.float64]:
        """Height (S,) of the edge between side and roof."""
        return self.half[:, self.corner, 1]

    @property
    def roof_half_width(self) -> NDArray[np.float64]:
        """Distance (S,) of that edge from the middle."""
        return self.half[:, self.corner, 0]


def loft(shape: CarShape, detail: int = 2) -> Loft:
    """Cross-sections of a body; detail 2 for near cars, 1 for far ones."""
    x = _section_positions(shape, detail)
    side, greenhouse = (_SIDE, _GREENHOUSE) if detail > 1 else (4, 6)
    width, lower, top = shape.half_width(x), shape.lower_edge(x), shape.top(x)
    shoulder = np.minimum(shape.belt(x), top - 0.06)
    lower = np.minimum(lower, shoulder - 0.03)
    points = [
        np.stack([np.zeros_like(x), lower], -1),
        np.stack([width * 0.80, lower], -1),
        np.stack([width * 0.95, lower + 0.015], -1),
    ]
    middle, height = (lower + shoulder) / 2, np.maximum(shoulder - lower, 0.1)
    for share in np.linspace(0.0, 1.0, side):
        z = lower + 0.05 * (1 - share) + (shoulder - lower) * share
        bulge = 1 - 0.045 * ((z - middle) / height * 2) ** 2 + 0.010 * np.exp(-(((z - shoulder + 0.11) / 0.04) ** 2))
        points.append(np.stack([width * bulge, z], -1))
    shoulder_width = points[-1][:, 0]
    rise = top - shoulder
    glassy = np.clip((rise - 0.12) / 0.3, 0, 1)
    exponent = _FLAT_GLASS_G + 2.8 * glassy
    for angle in np.linspace(0.0, np.pi / 2, greenhouse + 1)[1:]:
        cos, sin = max(np.cos(angle), 0.0) ** (2 / exponent), np.sin(angle) ** (2 / exponent)
        lean = 1 - glassy * (shape.tumblehome * rise * sin + 0.03)
        points.append(np.stack([shoulder_width * cos * lean, shoulder + rise * sin], -1))
    corner = _UNDERSIDE + side - 1 + greenhouse // 2
    return Loft(shape, x, np.stack(points, axis=1), corner)


def _section_positions(shape: CarShape, detail: int) -> NDArray[np.float64]:
    half = shape.length / 2
    u = np.linspace(-1.0, 1.0, 34 if detail > 1 else 17)
    x = half * np.sign(u) * (1 - (1 - np.abs(u)) ** 1.3)
    marks = [shape.cowl[0], shape.roof_front, shape.roof_rear, shape.rear_glass[0], half - NOSE_M, -half + TAIL_M]
    extra = [np.array(marks)]
    reach = shape.wheel_radius + 0.055
    for axle in (shape.front_axle, shape.rear_axle):
        x = x[np.abs(x - axle) > reach + 0.03]
        arch = reach * np.cos(np.linspace(0.0, np.pi, 11 if detail > 1 else 6))
        extra.append(axle + np.concatenate([arch, [reach + 2e-3, -reach - 2e-3]]))
    x = np.unique(np.concatenate([x, *extra]))
    return np.asarray(x[np.concatenate([[True], np.diff(x) > 1e-3])])


def body_mesh(body: Loft) -> Mesh:
    """The lofted skin with the texture coordinates of the car's atlas."""
    sections, ring_points = len(body.x), body.half.shape[1]
    ring = np.concatenate([body.half, body.half[:, -2::-1] * [-1.0, 1.0]], axis=1)
    across = ring.shape[1]
    position = np.concatenate([np.broadcast_to(body.x[:, None, None], (sections, across, 1)), ring], -1).reshape(-1, 3)
    faces = grid_faces(sections, across)[:, ::-1]
    cell = np.arange((sections - 1) * (across - 1)).reshape(sections - 1, across - 1)
    section_of, ring_of = np.divmod(np.concatenate([cell.ravel(), cell.ravel()]), across - 1)
    ends, end_faces = _end_caps(position, sections, across)
    position = np.concatenate([position, *ends])
    all_faces = np.concatenate([faces, *end_faces])
    normals = vertex_normals(position, all_faces)
    region = _regions(body, section_of, ring_of, ring_points, across)
    region = np.concatenate([region, np.full(len(end_faces[0]), 4), np.full(len(end_faces[1]), 3)])
    light = np.clip(0.35 + 0.9 * position[:, 2], 0.0, 1.0)
    tint = np.full((len(position), 4), 255, np.uint8)
    tint[:, 3] = (255 * light).astype(np.uint8)
    parts = []
    for number, name in enumerate(("underside", "side", "top", "front", "rear")):
        part = Mesh.of(position, normals, atlas_uv(body.shape, name, position), all_faces, tint).select(
            region == number
        )
        parts.append(part)
    return Mesh.concatenate(parts)


def _regions(
    body: Loft, section_of: NDArray[np.int64], ring_of: NDArray[np.int64], ring_points: int, across: int
) -> NDArray[np.int64]:
    """0 underside, 1 side, 2 top, 3 front, 4 rear for each face."""
    mirrored = np.where(ring_of < ring_points - 1, ring_of, across - 2 - ring_of)
    region = np.where(mirrored < _UNDERSIDE - 1, 0, np.where(mirrored < body.corner, 1, 2))
    middle = ((body.x[:-1] + body.x[1:]) / 2)[section_of]
    half = body.shape.length / 2
    region = np.where((middle > half - NOSE_M) & (region > 0), 3, region)
    return np.asarray(np.where((middle < -half + TAIL_M) & (region > 0), 4, region))


def _end_caps(
    position: NDArray[np.float64], sections: int, across: int
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.int32]]]:
    """Slightly domed ends: rear, then front."""
    vertices, faces = [], []
    first = len(position)
    for section, sign in ((0, -1.0), (sections - 1, 1.0)):
        rim = np.arange(section * across, (section + 1) * across)
        middle = position[rim].mean(axis=0)
        inner = middle + (position[rim] - middle) * [1.0, 0.75, 0.75] + [sign * 0.035, 0.0, 0.0]
        hub = shifted(inner.mean(axis=0), sign * 0.01, 0.0, 0.0)[None]
        a, b = rim[:-1], rim[1:]
        c, d = first + 1 + np.arange(across - 1), first + np.arange(across - 1)
        triangles = np.concatenate(
            [np.stack([a, b, c], -1), np.stack([a, c, d], -1), np.stack([d, c, np.full_like(c, first + across)], -1)]
        )
        faces.append((triangles[:, ::-1] if sign < 0 else triangles).astype(np.int32))
        vertices.append(np.concatenate([inner, hub]))
        first += across + 1
    return vertices, faces


def atlas_uv(shape: CarShape, region: str, position: NDArray[np.floating]) -> NDArray[np.float64]:
    """Texture coordinates (N, 2) of points on a car in one region of its atlas."""
    x, y, z = np.asarray(position, np.float64).T
    along = (x + shape.length / 2 + 0.06) / (shape.length + 0.12)
    across = y / (shape.width * 1.04) + 0.5
    up = 1.0 - z / (shape.height + 0.03)
    if region == "underside":
        return np.broadcast_to(_inside("side", 0.5, 0.995), (len(x), 2)).copy()
    picture = {"side": (along, up), "top": (along, across), "front": (across, up), "rear": (across, up)}[region]
    return _inside(region, *picture)


def _inside(region: str, u: NDArray[np.float64] | float, v: NDArray[np.float64] | float) -> NDArray[np.float64]:
    left, top, right, bottom = ATLAS_REGIONS[region]
    margin = 0.004
    u, v = np.clip(u, 0.0, 1.0), np.clip(v, 0.0, 1.0)
    return np.stack(
        [left + margin + u * (right - left - 2 * margin), top + margin + v * (bottom - top - 2 * margin)], -1
    )
