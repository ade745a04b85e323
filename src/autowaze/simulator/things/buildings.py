"""Buildings: walls with recessed windows, sills, doors, shop fronts, cornices and roofs.

A building stands with its front on the x axis, seen from y < 0: x runs to the right, y into the building, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from autowaze.simulator.mesh import Mesh, box, quads
from autowaze.simulator.surfaces.marks import MARK_CELLS, mark_cell
from autowaze.simulator.surfaces.masonry import ROOF_COLOURS, WALL_COLOURS, WALL_M
from autowaze.simulator.surfaces.openings import DOOR_CELLS, SHOP_CELLS, WINDOW_CELLS, shop_cell, window_cell

RGB = tuple[int, int, int]
Point3 = tuple[float, float, float]
BuildingPart = tuple[Mesh, str, bool]
"""A mesh, its surface, and whether it is too small to be seen from afar."""

_TRIM: RGB = (232, 228, 218)


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
class _Builder:
    """Collects quads by surface."""

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
        self.parts.setdefault((surface, fine), []).append(box(low, high, texture_m, (*tint, 255)))

    def meshes(self) -> list[BuildingPart]:
        flat = [
            (quads(self.corners[s], np.array(self.uvs[s]), np.array(self.tints[s])), s, s == "wall-marks")
            for s in self.corners
        ]
        return flat + [(Mesh.concatenate(parts), surface, fine) for (surface, fine), parts in self.parts.items()]


def build(style: BuildingStyle, rng: np.random.Generator, driveway: bool = False) -> list[BuildingPart]:
    """Everything that a building is made of."""
    b = _Builder(style, rng, texture_shift_m=(float(rng.uniform(0, WALL_M)), float(rng.uniform(0, WALL_M))))
    wall = f"wall-{style.wall}"
    _upper_floors(b, wall)
    if style.shop is not None:
        _shop_floor(b)
    else:
        _ground_floor(b, wall, driveway)
    _marks(b)
    _body(b, wall)
    {"flat": _flat_roof, "pitched": _pitched_roof, "mansard": _mansard_roof, "hipped": _pitched_roof}[style.roof](
        b, wall
    )
    return b.meshes()


def _upper_floors(b: _Builder, wall: str) -> None:
    s = b.style
    bay = s.width / s.windows
    for floor in range(1, s.floors):
        z0 = s.ground_m + (floor - 1) * s.floor_m
        z1 = z0 + s.floor_m
        sill = z0 + 0.75
        head = min(sill + s.window_height, z1 - 0.25)
        b.front(wall, 0, s.width, z0, sill, tint=s.wall_tint)
        b.front(wall, 0, s.width, head, z1, tint=s.wall_tint)
        x = 0.0
        for i in range(s.windows):
            x0 = (i + 0.5) * bay - s.window_width / 2
            x1 = x0 + s.window_width
            b.front(wall, x, x0, sill, head, tint=s.wall_tint)
            _window(b, x0, x1, sill, head)
            x = x1
        b.front(wall, x, s.width, sill, head, tint=s.wall_tint)
        if s.balconies and floor < s.floors - 1 + (s.roof == "flat"):
            _balcony(b, (s.windows // 2 + 0.5) * bay, z0)


def _window(b: _Builder, x0: float, x1: float, z0: float, z1: float) -> None:
    s = b.style
    # one frame for the whole building, another room behind each
    cell = s.window_cell // 4 * 4 + int(b.rng.integers(0, 4))
    b.opening(x0, x1, z0, z1, s.recess, "windows", window_cell(cell), _TRIM)
    b.solid("plain", (x0 - 0.10, -0.09, z0 - 0.10), (x1 + 0.10, 0.02, z0), _TRIM, 1.0, fine=True)
    if s.wall in ("brick", "stone") or s.floors > 3:
        b.solid(
            "plain",
            (x0 - 0.12, -0.05, z1),
            (x1 + 0.12, 0.02, z1 + 0.20),
            _TRIM if s.wall != "brick" else s.base_tint,
            1.0,
        )
    if s.wall == "boards":
        for side in (x0 - 0.42, x1 + 0.06):
            b.solid("plain", (side, -0.05, z0), (side + 0.36, 0.0, z1), s.roof_tint, 1.0, fine=True)


def _marks(b: _Builder) -> None:
    """What hangs, grows or is sprayed on a wall; no two walls carry the same."""
    s = b.style
    for _ in range(int(b.rng.integers(5, 11))):
        size = float(b.rng.uniform(0.25, 1.0))
        x = float(b.rng.uniform(0.1, max(0.2, s.width - size - 0.1)))
        low = float(b.rng.uniform(0.2, s.eaves - 1.2)) if b.rng.random() < 0.6 else float(b.rng.uniform(0.2, 2.0))
        if s.shop is not None:
            low = max(low, s.ground_m)
        b.front("wall-marks", x, x + size, low, low + size, -0.012, cell=mark_cell(int(b.rng.integers(0, MARK_CELLS))))
    if b.rng.random() < 0.8:
        x = 0.12 if b.rng.random() < 0.5 else s.width - 0.2
        b.solid("metal", (x, -0.10, 0.0), (x + 0.09, -0.01, s.eaves), (118, 120, 122), 1.0, fine=True)


def _balcony(b: _Builder, x: float, z: float) -> None:
    b.solid("plain", (x - 1.1, -0.85, z + 0.05), (x + 1.1, 0.0, z + 0.18), _TRIM, 1.0, fine=True)
    b.solid("metal", (x - 1.1, -0.85, z + 1.05), (x + 1.1, -0.80, z + 1.10), (60, 62, 64), 1.0, fine=True)
    for i in np.linspace(-1.08, 1.08, 13):
        b.solid(
            "metal", (x + i - 0.012, -0.83, z + 0.18), (x + i + 0.012, -0.81, z + 1.05), (60, 62, 64), 1.0, fine=True
        )


def _ground_floor(b: _Builder, wall: str, driveway: bool) -> None:
    s = b.style
    base = 0.55
    bay = s.width / s.windows
    door = int(b.rng.integers(0, s.windows))
    garage = (door + 1) % s.windows if driveway else -1
    sill, head = base + 0.45, min(base + 0.45 + s.window_height, s.ground_m - 0.45)
    b.front(wall, 0, s.width, head, s.ground_m, tint=s.wall_tint)
    for i in range(s.windows):
        left, right, middle = i * bay, (i + 1) * bay, (i + 0.5) * bay
        if i in (door, garage):
            half = min(1.2 if i == garage else 0.55, bay / 2 - 0.1)
            cell = (0.0, 0.0, 1.0, 1.0) if i == garage else window_cell(WINDOW_CELLS + s.door)
            b.front(wall, left, middle - half, 0, head, tint=s.wall_tint, light=0.92)
            b.front(wall, middle + half, right, 0, head, tint=s.wall_tint, light=0.92)
            b.opening(
                middle - half, middle + half, 0.12, head, 0.28, "garage" if i == garage else "windows", cell, _TRIM
            )
            b.front("plain", middle - half, middle + half, 0, 0.12, tint=s.base_tint)
            if i == door:
                b.solid("plain", (middle - 0.75, -0.35, 0.0), (middle + 0.75, 0.0, 0.14), s.base_tint, 1.0)
                b.solid("plain", (middle - 0.85, -0.45, head + 0.08), (middle + 0.85, 0.0, head + 0.18), _TRIM, 1.0)
            continue
        x0, x1 = middle - s.window_width / 2, middle + s.window_width / 2
        b.front("plain", left, right, 0, base, tint=s.base_tint, light=0.9)
        b.front(wall, left, right, base, sill, tint=s.wall_tint, light=0.95)
        b.front(wall, left, x0, sill, head, tint=s.wall_tint)
        b.front(wall, x1, right, sill, head, tint=s.wall_tint)
        _window(b, x0, x1, sill, head)
    if s.floors > 3:
        b.solid("plain", (-0.02, -0.08, s.ground_m - 0.18), (s.width + 0.02, 0.02, s.ground_m), _TRIM, 1.0)


def _shop_floor(b: _Builder) -> None:
    s = b.style
    top = s.ground_m - 0.25
    cell = shop_cell(s.shop or 0)
    pier = 0.35
    b.front("plain", 0, pier, 0, s.ground_m, tint=s.base_tint)
    b.front("plain", s.width - pier, s.width, 0, s.ground_m, tint=s.base_tint)
    b.front("plain", pier, s.width - pier, top, s.ground_m, tint=s.base_tint)
    left, upper, right, lower = cell
    board = upper + 0.24 * (lower - upper)
    sign_z = top - 0.24 * (top - 0.0)
    b.opening(pier, s.width - pier, 0.0, sign_z, 0.22, "shops", (left, board, right, lower), s.base_tint)
    b.front("shops", pier, s.width - pier, sign_z, top, -0.06, cell=(left, upper, right, board))
    b.solid("plain", (0.0, -0.16, top), (s.width, 0.0, top + 0.14), _TRIM, 1.0)
    if s.awning:
        reach, drop = 1.3, 0.55
        ring: list[Point3] = [
            (pier, -reach, sign_z - drop),
            (s.width - pier, -reach, sign_z - drop),
            (s.width - pier, -0.06, sign_z),
            (pier, -0.06, sign_z),
        ]
        repeat = (s.width - 2 * pier) / 2.0
        uv = [(0.0, 1.0), (repeat, 1.0), (repeat, 0.0), (0.0, 0.0)]
        b.quad("awning", ring, uv, (255, 255, 255))
        b.quad("awning", ring[::-1], uv[::-1], (255, 255, 255), 0.5)
        b.front(
            "awning", pier, s.width - pier, sign_z - drop - 0.18, sign_z - drop, -reach, cell=(0.0, 0.9, repeat, 1.0)
        )


def _body(b: _Builder, wall: str) -> None:
    """Side and rear walls."""
    s = b.style
    w, d, h = s.width, s.depth, s.eaves
    u, v = d / WALL_M, -h / WALL_M
    uv = [(0.0, 0.0), (u, 0.0), (u, v), (0.0, v)]
    b.quad(wall, [(0, d, 0), (0, 0, 0), (0, 0, h), (0, d, h)], uv, s.wall_tint, 0.92)
    b.quad(wall, [(w, 0, 0), (w, d, 0), (w, d, h), (w, 0, h)], uv, s.wall_tint, 0.92)
    wide = w / WALL_M
    b.quad(wall, [(w, d, 0), (0, d, 0), (0, d, h), (w, d, h)], [(0, 0), (wide, 0), (wide, v), (0, v)], s.wall_tint)
    for floor in range(s.floors):
        z = (s.ground_m + (floor - 1) * s.floor_m if floor else 0.4) + 0.75
        cell = window_cell(s.window_cell)
        left, top, right, bottom = cell
        cell_uv = [(left, bottom), (right, bottom), (right, top), (left, top)]
        for y in np.arange(1.8, d - 1.5, 3.1):
            b.quad(
                "windows",
                [(-0.015, y + 1.0, z), (-0.015, y, z), (-0.015, y, z + 1.4), (-0.015, y + 1.0, z + 1.4)],
                cell_uv,
                (255, 255, 255),
            )
            b.quad(
                "windows",
                [(w + 0.015, y, z), (w + 0.015, y + 1.0, z), (w + 0.015, y + 1.0, z + 1.4), (w + 0.015, y, z + 1.4)],
                cell_uv,
                (255, 255, 255),
            )


def _flat_roof(b: _Builder, wall: str) -> None:
    s = b.style
    h = s.eaves
    b.quad(
        "plain",
        [(0, 0, h), (s.width, 0, h), (s.width, s.depth, h), (0, s.depth, h)],
        [(0, 0), (4, 0), (4, 4), (0, 4)],
        (120, 118, 114),
    )
    b.solid(wall, (0.0, 0.0, h), (s.width, 0.25, h + 0.55), s.wall_tint)
    b.solid("plain", (-0.05, -0.30, h - 0.02), (s.width + 0.05, 0.3, h + 0.14), _TRIM, 1.0)
    b.solid("plain", (-0.03, -0.10, h + 0.55), (s.width + 0.03, 0.32, h + 0.63), _TRIM, 1.0)
    if b.rng.random() < 0.6:
        x = float(b.rng.uniform(1, s.width - 2))
        b.solid("wall-brick", (x, s.depth * 0.5, h), (x + 0.8, s.depth * 0.5 + 0.6, h + 1.8), (150, 98, 76))


def _pitched_roof(b: _Builder, wall: str) -> None:
    s = b.style
    h, over = s.eaves, 0.45
    rise = s.depth * float(b.rng.uniform(0.30, 0.46))
    w, d, top = s.width, s.depth, h + rise
    hip = min(w, d) * 0.35 if s.roof == "hipped" else 0.0
    slope = float(np.hypot(d / 2 + over, rise)) / WALL_M
    low = h - over * rise / (d / 2)
    x0, x1 = (-over, w + over) if s.roof == "hipped" else (0.0, w)
    wide = (x1 - x0) / WALL_M
    uv = [(0.0, 0.0), (wide, 0.0), (wide - hip / WALL_M, -slope), (hip / WALL_M, -slope)]
    ridge0, ridge1 = x0 + hip, x1 - hip
    b.quad("roof", [(x0, -over, low), (x1, -over, low), (ridge1, d / 2, top), (ridge0, d / 2, top)], uv, s.roof_tint)
    b.quad(
        "roof", [(x1, d + over, low), (x0, d + over, low), (ridge0, d / 2, top), (ridge1, d / 2, top)], uv, s.roof_tint
    )
    ends = [
        ((x0, d + over, low), (x0, -over, low), (ridge0, d / 2, top)),
        ((x1, -over, low), (x1, d + over, low), (ridge1, d / 2, top)),
    ]
    for p, q, r in ends:
        surface, tint = ("roof", s.roof_tint) if hip else (wall, s.wall_tint)
        b.quad(
            surface, [p, q, r, r], [(0, 0), (d / WALL_M, 0), (d / 2 / WALL_M, -slope), (d / 2 / WALL_M, -slope)], tint
        )
    b.solid("plain", (x0, -over - 0.08, low - 0.10), (x1, -over + 0.04, low + 0.02), (96, 98, 100), 1.0)
    b.quad(
        "plain",
        [(x0, 0.0, low), (x1, 0.0, low), (x1, -over, low), (x0, -over, low)],
        [(0, 0), (3, 0), (3, 0.3), (0, 0.3)],
        _TRIM,
        0.6,
    )
    x = float(b.rng.uniform(0.15, 0.8)) * w
    b.solid("wall-brick", (x, d * 0.42, h + rise * 0.5), (x + 0.8, d * 0.42 + 0.6, top + 0.8), (150, 98, 76))
    if s.roof == "pitched" and s.windows > 2:
        _dormers(b, h, rise)


def _dormers(b: _Builder, h: float, rise: float) -> None:
    s = b.style
    for i in range(s.windows - 1):
        if b.rng.random() < 0.45:
            continue
        x = (i + 1) * s.width / s.windows
        y = s.depth * 0.16
        z = h + rise * 0.32 * 0.9
        b.solid("plain", (x - 0.65, y, z - 0.3), (x + 0.65, s.depth * 0.42, z + 1.25), s.roof_tint, 1.0)
        b.front("windows", x - 0.5, x + 0.5, z, z + 1.1, y - 0.02, cell=window_cell(s.window_cell))


def _mansard_roof(b: _Builder, wall: str) -> None:
    s = b.style
    h, w, d = s.eaves, s.width, s.depth
    top, back = h + 2.6, 1.0
    wide, slope = w / WALL_M, 2.8 / WALL_M
    uv = [(0.0, 0.0), (wide, 0.0), (wide, -slope), (0.0, -slope)]
    b.quad("roof", [(0, 0, h), (w, 0, h), (w, back, top), (0, back, top)], uv, s.roof_tint)
    b.quad("roof", [(0, back, top), (w, back, top), (w, d, top), (0, d, top)], uv, s.roof_tint)
    for x in (0.0, w):
        ring: list[Point3] = [(x, d, h), (x, 0, h), (x, back, top), (x, d, top)]
        b.quad(wall, ring if x == 0 else ring[::-1], [(0, 0), (2, 0), (2, -0.8), (0, -0.8)], s.wall_tint)
    b.solid("plain", (-0.05, -0.28, h - 0.16), (w + 0.05, 0.05, h + 0.05), _TRIM, 1.0)
    bay = w / s.windows
    for i in range(s.windows):
        x = (i + 0.5) * bay
        b.solid("plain", (x - 0.6, 0.12, h + 0.3), (x + 0.6, 1.2, h + 2.1), _TRIM, 1.0)
        b.front("windows", x - 0.48, x + 0.48, h + 0.45, h + 1.95, 0.10, cell=window_cell(s.window_cell))
