"""What every part of a building adds to: its style, and the walls and solids made so far.

A building stands with its front on the x axis, seen from y < 0: x runs to the right, y into the building, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from autowaze.simulator.mesh import Mesh, box, quads
from autowaze.simulator.surfaces.masonry import ROOF_COLOURS, WALL_COLOURS, WALL_M
from autowaze.simulator.surfaces.openings import DOOR_CELLS, SHOP_CELLS, WINDOW_CELLS

RGB = tuple[int, int, int]
Point3 = tuple[float, float, float]
BuildingPart = tuple[Mesh, str, bool]
"""A mesh, its surface, and whether it is too small to be seen from afar."""

TRIM: RGB = (232, 228, 218)


@dataclass(frozen=True)
class BuildingStyle:
    """What one building looks like."""

    width: float
    depth: float
    floors: int
    floor_m: float
    ground_m: float
    wall: str
    wall_tint: RGB
    base_tint: RGB
    roof: str
    roof_tint: RGB
    window_cell: int
    windows: int
    window_width: float
    window_height: float
    recess: float
    shop: int | None
    awning: bool
    door: int
    balconies: bool

    @property
    def eaves(self) -> float:
        """Height of the top of the wall."""
        return self.ground_m + (self.floors - 1) * self.floor_m


def draw_style(rng: np.random.Generator, kind: str, width: float) -> BuildingStyle:
    """A building of a kind (terraces, shops or houses) at random."""
    house = kind == "houses"
    wall = str(
        rng.choice(
            ["brick", "render", "stone", "boards"], p=[0.25, 0.35, 0.05, 0.35] if house else [0.42, 0.40, 0.16, 0.02]
        )
    )
    tint = _varied(rng, WALL_COLOURS[wall], 8)
    floors = int(rng.integers(2, 4)) if house else int(rng.integers(3, 6))
    pitch = float(rng.uniform(2.3, 3.2))
    return BuildingStyle(
        width=width,
        depth=float(rng.uniform(8.5, 11.0)),
        floors=floors,
        floor_m=float(rng.uniform(2.8, 3.5)),
        ground_m=float(rng.uniform(3.0, 3.3) if house else rng.uniform(3.5, 4.2)),
        wall=wall,
        wall_tint=tint,
        base_tint=_varied(rng, [(150, 146, 140), (120, 112, 104), (190, 180, 166)], 8),
        roof=str(rng.choice(["pitched", "hipped"] if house else ["pitched", "flat", "mansard", "flat"])),
        roof_tint=_varied(rng, ROOF_COLOURS, 10),
        window_cell=int(rng.integers(0, WINDOW_CELLS)),
        windows=max(2, int(width / pitch)),
        window_width=float(rng.uniform(0.95, 1.35)),
        window_height=float(rng.uniform(1.35, 1.9)),
        recess=float(rng.uniform(0.10, 0.26)),
        shop=int(rng.integers(0, SHOP_CELLS))
        if kind == "shops" or (kind == "terraces" and rng.random() < 0.25)
        else None,
        awning=bool(rng.random() < 0.4),
        door=int(rng.integers(0, DOOR_CELLS)),
        balconies=bool(rng.random() < 0.25),
    )


def _varied(rng: np.random.Generator, colours: list[RGB], spread: float) -> RGB:
    base = np.array(colours[int(rng.integers(0, len(colours)))]) + rng.normal(0, spread) + rng.normal(0, spread / 2, 3)
    r, g, b = np.clip(base, 20, 250).astype(int)
    return int(r), int(g), int(b)


@dataclass
class BuildingShell:
    """The parts of one building by surface."""

    style: BuildingStyle
    rng: np.random.Generator
    parts: dict[tuple[str, bool], list[Mesh]] = field(default_factory=dict)
    corners: dict[str, list[list[Point3]]] = field(default_factory=dict)
    uvs: dict[str, list[list[tuple[float, float]]]] = field(default_factory=dict)
    tints: dict[str, list[tuple[int, int, int, int]]] = field(default_factory=dict)
    texture_shift_m: tuple[float, float] = (0.0, 0.0)

    def quad(
        self, surface: str, ring: list[Point3], uv: list[tuple[float, float]], tint: RGB, light: float = 1.0
    ) -> None:
        """Any flat four-sided piece; `light` is the share of ambient light that reaches it."""
        self.corners.setdefault(surface, []).append(ring)
        self.uvs.setdefault(surface, []).append(uv)
        self.tints.setdefault(surface, []).append((*tint, int(255 * light)))

    def front(
        self,
        surface: str,
        x0: float,
        x1: float,
        z0: float,
        z1: float,
        y: float = 0.0,
        tint: RGB = (255, 255, 255),
        light: float = 1.0,
        cell: tuple[float, float, float, float] | None = None,
    ) -> None:
        """A rectangle that faces the street; textured in metres, or with a cell of an atlas."""
        if x1 - x0 < 1e-3 or z1 - z0 < 1e-3:
            return
        if cell is None:
            du, dz = self.texture_shift_m
            u0, u1, v0, v1 = (x0 + du) / WALL_M, (x1 + du) / WALL_M, -(z0 + dz) / WALL_M, -(z1 + dz) / WALL_M
            uv = [(u0, v0), (u1, v0), (u1, v1), (u0, v1)]
        else:
            left, top, right, bottom = cell
            uv = [(left, bottom), (right, bottom), (right, top), (left, top)]
        self.quad(surface, [(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)], uv, tint, light)

    def opening(
        self,
        x0: float,
        x1: float,
        z0: float,
        z1: float,
        depth: float,
        pane: str,
        cell: tuple[float, float, float, float],
        reveal: RGB,
    ) -> None:
        """The four sides of a recess and what closes it."""
        sides: list[tuple[list[Point3], float]] = [
            ([(x0, 0, z0), (x0, depth, z0), (x0, depth, z1), (x0, 0, z1)], 0.75),
            ([(x1, depth, z0), (x1, 0, z0), (x1, 0, z1), (x1, depth, z1)], 0.75),
            ([(x0, depth, z1), (x1, depth, z1), (x1, 0, z1), (x0, 0, z1)], 0.55),
            ([(x0, 0, z0), (x1, 0, z0), (x1, depth, z0), (x0, depth, z0)], 0.9),
        ]
        for ring, light in sides:
            self.quad("plain", ring, [(0, 0), (0.3, 0), (0.3, 1), (0, 1)], reveal, light)
        self.front(pane, x0, x1, z0, z1, depth, light=0.85, cell=cell)

    def solid(
        self, surface: str, low: Point3, high: Point3, tint: RGB, texture_m: float = WALL_M, fine: bool = False
    ) -> None:
        """A box between two corners."""
        self.parts.setdefault((surface, fine), []).append(box(low, high, texture_m, (*tint, 255)))

    def meshes(self) -> list[BuildingPart]:
        """Everything made so far."""
        flat = [
            (quads(self.corners[s], np.array(self.uvs[s]), np.array(self.tints[s])), s, s == "wall-marks")
            for s in self.corners
        ]
        return flat + [(Mesh.concatenate(parts), surface, fine) for (surface, fine), parts in self.parts.items()]
