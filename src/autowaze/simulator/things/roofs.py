"""Roofs of buildings."""

from __future__ import annotations

import numpy as np

from autowaze.simulator.surfaces.masonry import WALL_M
from autowaze.simulator.surfaces.openings import window_cell
from autowaze.simulator.things.building_shell import TRIM, BuildingShell, Point3


def flat_roof(b: BuildingShell, wall: str) -> None:
    """A parapet and a cornice."""
    s = b.style
    h = s.eaves
    b.quad(
        "plain",
        [(0, 0, h), (s.width, 0, h), (s.width, s.depth, h), (0, s.depth, h)],
        [(0, 0), (4, 0), (4, 4), (0, 4)],
        (120, 118, 114),
    )
    b.solid(wall, (0.0, 0.0, h), (s.width, 0.25, h + 0.55), s.wall_tint)
    b.solid("plain", (-0.05, -0.30, h - 0.02), (s.width + 0.05, 0.3, h + 0.14), TRIM, 1.0)
    b.solid("plain", (-0.03, -0.10, h + 0.55), (s.width + 0.03, 0.32, h + 0.63), TRIM, 1.0)
    if b.rng.random() < 0.6:
        x = float(b.rng.uniform(1, s.width - 2))
        b.solid("wall-brick", (x, s.depth * 0.5, h), (x + 0.8, s.depth * 0.5 + 0.6, h + 1.8), (150, 98, 76))


def pitched_roof(b: BuildingShell, wall: str) -> None:
    """A ridge along the street, with gables or hipped, dormers and a chimney."""
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
        TRIM,
        0.6,
    )
    x = float(b.rng.uniform(0.15, 0.8)) * w
    b.solid("wall-brick", (x, d * 0.42, h + rise * 0.5), (x + 0.8, d * 0.42 + 0.6, top + 0.8), (150, 98, 76))
    if s.roof == "pitched" and s.windows > 2:
        _dormers(b, h, rise)


def _dormers(b: BuildingShell, h: float, rise: float) -> None:
    s = b.style
    for i in range(s.windows - 1):
        if b.rng.random() < 0.45:
            continue
        x = (i + 1) * s.width / s.windows
        y = s.depth * 0.16
        z = h + rise * 0.32 * 0.9
        b.solid("plain", (x - 0.65, y, z - 0.3), (x + 0.65, s.depth * 0.42, z + 1.25), s.roof_tint, 1.0)
        b.front("windows", x - 0.5, x + 0.5, z, z + 1.1, y - 0.02, cell=window_cell(s.window_cell))


def mansard_roof(b: BuildingShell, wall: str) -> None:
    """A steep storey of tiles with windows."""
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
    b.solid("plain", (-0.05, -0.28, h - 0.16), (w + 0.05, 0.05, h + 0.05), TRIM, 1.0)
    bay = w / s.windows
    for i in range(s.windows):
        x = (i + 0.5) * bay
        b.solid("plain", (x - 0.6, 0.12, h + 0.3), (x + 0.6, 1.2, h + 2.1), TRIM, 1.0)
        b.front("windows", x - 0.48, x + 0.48, h + 0.45, h + 1.95, 0.10, cell=window_cell(s.window_cell))
