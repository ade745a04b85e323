"""Buildings: walls with recessed windows, sills, doors, shop fronts and what hangs on them."""

from __future__ import annotations

import numpy as np

from autowaze.simulator.surfaces.marks import MARK_CELLS, mark_cell
from autowaze.simulator.surfaces.masonry import WALL_M
from autowaze.simulator.surfaces.openings import WINDOW_CELLS, shop_cell, window_cell
from autowaze.simulator.things.building_shell import TRIM, BuildingPart, BuildingShell, BuildingStyle, Point3
from autowaze.simulator.things.roofs import flat_roof, mansard_roof, pitched_roof


def build(style: BuildingStyle, rng: np.random.Generator, driveway: bool = False) -> list[BuildingPart]:
    """Everything that a building is made of."""
    b = BuildingShell(style, rng, texture_shift_m=(float(rng.uniform(0, WALL_M)), float(rng.uniform(0, WALL_M))))
    wall = f"wall-{style.wall}"
    _upper_floors(b, wall)
    if style.shop is not None:
        _shop_floor(b)
    else:
        _ground_floor(b, wall, driveway)
    _marks(b)
    _body(b, wall)
    {"flat": flat_roof, "pitched": pitched_roof, "mansard": mansard_roof, "hipped": pitched_roof}[style.roof](b, wall)
    return b.meshes()


def _upper_floors(b: BuildingShell, wall: str) -> None:
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


def _window(b: BuildingShell, x0: float, x1: float, z0: float, z1: float) -> None:
    s = b.style
    # one frame for the whole building, another room behind each
    cell = s.window_cell // 4 * 4 + int(b.rng.integers(0, 4))
    b.opening(x0, x1, z0, z1, s.recess, "windows", window_cell(cell), TRIM)
    b.solid("plain", (x0 - 0.10, -0.09, z0 - 0.10), (x1 + 0.10, 0.02, z0), TRIM, 1.0, fine=True)
    if s.wall in ("brick", "stone") or s.floors > 3:
        b.solid(
            "plain",
            (x0 - 0.12, -0.05, z1),
            (x1 + 0.12, 0.02, z1 + 0.20),
            TRIM if s.wall != "brick" else s.base_tint,
            1.0,
        )
    if s.wall == "boards":
        for side in (x0 - 0.42, x1 + 0.06):
            b.solid("plain", (side, -0.05, z0), (side + 0.36, 0.0, z1), s.roof_tint, 1.0, fine=True)


def _marks(b: BuildingShell) -> None:
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


def _balcony(b: BuildingShell, x: float, z: float) -> None:
    b.solid("plain", (x - 1.1, -0.85, z + 0.05), (x + 1.1, 0.0, z + 0.18), TRIM, 1.0, fine=True)
    b.solid("metal", (x - 1.1, -0.85, z + 1.05), (x + 1.1, -0.80, z + 1.10), (60, 62, 64), 1.0, fine=True)
    for i in np.linspace(-1.08, 1.08, 13):
        b.solid(
            "metal", (x + i - 0.012, -0.83, z + 0.18), (x + i + 0.012, -0.81, z + 1.05), (60, 62, 64), 1.0, fine=True
        )


def _ground_floor(b: BuildingShell, wall: str, driveway: bool) -> None:
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
                middle - half, middle + half, 0.12, head, 0.28, "garage" if i == garage else "windows", cell, TRIM
            )
            b.front("plain", middle - half, middle + half, 0, 0.12, tint=s.base_tint)
            if i == door:
                b.solid("plain", (middle - 0.75, -0.35, 0.0), (middle + 0.75, 0.0, 0.14), s.base_tint, 1.0)
                b.solid("plain", (middle - 0.85, -0.45, head + 0.08), (middle + 0.85, 0.0, head + 0.18), TRIM, 1.0)
            continue
        x0, x1 = middle - s.window_width / 2, middle + s.window_width / 2
        b.front("plain", left, right, 0, base, tint=s.base_tint, light=0.9)
        b.front(wall, left, right, base, sill, tint=s.wall_tint, light=0.95)
        b.front(wall, left, x0, sill, head, tint=s.wall_tint)
        b.front(wall, x1, right, sill, head, tint=s.wall_tint)
        _window(b, x0, x1, sill, head)
    if s.floors > 3:
        b.solid("plain", (-0.02, -0.08, s.ground_m - 0.18), (s.width + 0.02, 0.02, s.ground_m), TRIM, 1.0)


def _shop_floor(b: BuildingShell) -> None:
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
    b.solid("plain", (0.0, -0.16, top), (s.width, 0.0, top + 0.14), TRIM, 1.0)
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


def _body(b: BuildingShell, wall: str) -> None:
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
