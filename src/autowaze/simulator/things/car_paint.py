"""The painted skin of a car: glass, lamps, seams, grille, plates and wheels in one texture."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.surfaces.finish import GLASS, MATTE, TINTED
from autowaze.simulator.surfaces.noise import layered_noise
from autowaze.simulator.things.car_body import TAIL_M, Loft, atlas_uv

Colour = tuple[int, int, int, int]

PAINT: Colour = (250, 250, 250, TINTED)
_SEAM: Colour = (96, 96, 96, TINTED)
_GAP: Colour = (52, 52, 54, TINTED)
_CREASE: Colour = (255, 255, 255, TINTED)
_HANDLE: Colour = (190, 190, 190, TINTED)
_PANE: Colour = (20, 24, 28, GLASS)
_PANE_LIGHT: Colour = (46, 53, 58, GLASS)
_SEAT: Colour = (9, 10, 12, GLASS)
_RUBBER: Colour = (17, 17, 18, MATTE)
_PLASTIC: Colour = (38, 38, 40, MATTE)
_CHROME: Colour = (170, 172, 176, GLASS)
_LAMP: Colour = (196, 200, 205, GLASS)
_LAMP_RIM: Colour = (44, 46, 50, GLASS)
_TAIL_LAMP: Colour = (150, 12, 16, GLASS)
_REVERSING: Colour = (206, 198, 194, GLASS)
_INDICATOR: Colour = (205, 120, 30, GLASS)
_PLATE: Colour = (226, 226, 218, MATTE)
_PLATE_INK: Colour = (26, 26, 28, MATTE)
_OVERSAMPLED = 2


class CarPainter:
    """Draws on a car's texture in metres on the car."""

    def __init__(self, body: Loft, size: int = 768) -> None:
        self.body, self.shape, self.size = body, body.shape, size
        self.texture: NDArray[np.uint8] = np.empty((size, size, 4), np.uint8)
        self.texture[:] = PAINT

    def polygon(self, region: str, points: Sequence[tuple[float, float]], colour: Colour) -> None:
        """Fill; the points are x, z on the side, x, y on top, y, z at the ends."""
        cv2.fillPoly(self.texture, [self._pixels(region, points)], colour, cv2.LINE_8, 4)

    def line(self, region: str, points: Sequence[tuple[float, float]], colour: Colour, thickness: int = 2) -> None:
        """Stroke; thickness in texels of the finished texture."""
        points_px = [self._pixels(region, points)]
        cv2.polylines(self.texture, points_px, False, colour, _OVERSAMPLED * thickness, cv2.LINE_8, 4)

    def ellipse(
        self,
        region: str,
        centre: tuple[float, float],
        radii: tuple[float, float],
        colour: Colour,
        over: tuple[Colour, ...] = (),
    ) -> None:
        """Fill an ellipse, only where one of some colours lies if there are any."""
        angle = np.linspace(0, 2 * np.pi, 28)
        points = np.stack([centre[0] + radii[0] * np.cos(angle), centre[1] + radii[1] * np.sin(angle)], -1)
        before = self.texture.copy() if over else self.texture
        self.polygon(region, [(float(a), float(b)) for a, b in points], colour)
        if over:
            covers = np.any([(before == c).all(axis=2) for c in over], axis=0)
            self.texture[~covers] = before[~covers]

    def _pixels(self, region: str, points: Sequence[tuple[float, float]]) -> NDArray[np.int32]:
        flat = np.array(points, np.float64)
        position = np.zeros((len(flat), 3))
        axes = {"side": (0, 2), "top": (0, 1), "front": (1, 2), "rear": (1, 2)}[region]
        position[:, axes[0]], position[:, axes[1]] = flat.T
        uv = atlas_uv(self.shape, region, position)
        return np.asarray(np.round((uv * self.size - 0.5) * 16), np.int32)


def paint_car(body: Loft, rng: np.random.Generator, size: int = 768) -> NDArray[np.uint8]:
    """Texture (size, size, 4) of a car; alpha is the finish."""
    painter = CarPainter(body, _OVERSAMPLED * size)
    _paint_side(painter, rng)
    _paint_top(painter)
    _paint_front(painter, rng)
    _paint_rear(painter, rng)
    _paint_wheel(painter, rng)
    # painted large and shrunk, edges come out smooth
    texture = cv2.resize(painter.texture, (size, size), interpolation=cv2.INTER_AREA)
    dirt = 1.0 + 0.02 * layered_noise(rng, size, size, 8, 6, 0.7)
    texture[..., :3] = np.clip(texture[..., :3] * dirt[..., None], 0, 255).astype(np.uint8)
    return np.asarray(texture, np.uint8)


def _curve(xs: NDArray[np.float64], zs: NDArray[np.float64]) -> list[tuple[float, float]]:
    return [(float(x), float(z)) for x, z in zip(xs, zs, strict=True)]


def _paint_side(p: CarPainter, rng: np.random.Generator) -> None:
    shape = p.shape
    half = shape.length / 2
    x = np.linspace(-half, half, 160)
    trim = shape.lower_edge(x) + (0.10 if shape.kind in ("suv", "pickup") else 0.045)
    low = np.full_like(x, -0.05)
    p.polygon("side", _curve(x, trim) + _curve(x[::-1], low), _PLASTIC if shape.kind != "sports" else PAINT)
    p.polygon("side", [(-half, 0.08), (half, 0.08), (half, -0.05), (-half, -0.05)], _RUBBER)
    _paint_side_windows(p)
    belt = shape.belt(x)
    doors = [shape.cowl[0] - 0.22, *shape.pillars]
    if shape.blind_rear:
        doors.append(shape.rear_axle + shape.wheel_radius + 0.22)
    elif len(shape.pillars) < 2 and shape.kind not in ("sports", "pickup"):
        doors.append(max(shape.rear_glass[0] + 0.40, shape.rear_axle + 0.12))
    for door in doors:
        bottom = max(float(shape.lower_edge(np.array(door))), shape.sill) + 0.08
        p.line("side", [(door, bottom), (door, float(shape.belt(np.array(door))))], _SEAM, 2)
    doors_from, doors_to = shape.rear_axle + 0.42, shape.front_axle - 0.40
    p.line("side", [(doors_from, shape.sill + 0.10), (doors_to, shape.sill + 0.10)], _SEAM, 2)
    wheels = (x > shape.rear_axle - 0.5) & (x < shape.front_axle + 0.4)
    p.line("side", _curve(x[wheels], belt[wheels] - 0.12), _CREASE, 2)
    p.line("side", _curve(x[wheels], belt[wheels] - 0.135), (205, 205, 205, TINTED), 2)
    for door in doors[1:] if len(doors) > 1 else doors:
        z = float(shape.belt(np.array(door))) - 0.10
        p.polygon(
            "side", [(door + 0.05, z), (door + 0.24, z), (door + 0.24, z - 0.03), (door + 0.05, z - 0.03)], _HANDLE
        )
    nose, tail = shape.nose, shape.tail
    p.polygon(
        "side",
        [(half, nose - 0.01), (half - 0.36, nose + 0.05), (half - 0.30, nose - 0.07), (half, nose - 0.14)],
        _LAMP,
    )
    p.polygon("side", [(half - 0.30, nose + 0.035), (half - 0.36, nose + 0.05), (half - 0.30, nose - 0.07)], _INDICATOR)
    p.polygon(
        "side",
        [(-half, tail - 0.02), (-half + 0.24, tail - 0.05), (-half + 0.17, tail - 0.20), (-half, tail - 0.24)],
        _TAIL_LAMP,
    )
    if rng.random() < 0.25:
        z = 0.5 * (shape.sill + float(shape.belt(np.array(0.0))))
        p.polygon("side", [(doors_from, z), (doors_to, z), (doors_to, z - 0.05), (doors_from, z - 0.05)], _PLASTIC)


def _paint_side_windows(p: CarPainter) -> None:
    shape, body = p.shape, p.body
    x = np.linspace(shape.rear_glass[0] + 0.06, shape.cowl[0] - 0.10, 120)
    upper = np.interp(x, body.x, body.window_top) - 0.045
    lower = shape.belt(x) + 0.035
    open_ = upper > lower + 0.03
    x, upper, lower = x[open_], upper[open_], lower[open_]
    if len(x) < 4:
        return
    if not shape.blind_rear:
        p.polygon("side", _curve(x, upper + 0.02) + _curve(x[::-1], lower[::-1] - 0.025), _RUBBER)
    edges = [float(x[0]) - 0.05, *sorted(shape.pillars), float(x[-1]) + 0.05]
    for index, (a, b) in enumerate(pairwise(edges)):
        if shape.blind_rear and index == 0:
            continue
        m = (x > a + 0.045) & (x < b - 0.045)
        if m.sum() < 3:
            continue
        pane = _curve(x[m], upper[m]) + _curve(x[m][::-1], lower[m][::-1])
        p.polygon("side", _curve(x[m], upper[m] + 0.02) + _curve(x[m][::-1], lower[m][::-1] - 0.025), _RUBBER)
        p.polygon("side", pane, _PANE)
        band = lower[m] + 0.45 * (upper[m] - lower[m])
        p.polygon("side", _curve(x[m], upper[m]) + _curve(x[m][::-1], band[::-1]), _PANE_LIGHT)
        seat = float(x[m].mean()) - 0.18
        z = float(lower[m].mean())
        if m.sum() * (x[1] - x[0]) > 0.55:
            p.ellipse("side", (seat, z + 0.08), (0.11, 0.16), _SEAT, over=(_PANE, _PANE_LIGHT))
            p.ellipse("side", (seat - 0.03, z + 0.27), (0.07, 0.08), _SEAT, over=(_PANE, _PANE_LIGHT))


def _paint_top(p: CarPainter) -> None:
    shape, body = p.shape, p.body
    half = shape.length / 2

    def pane(start: float, end: float, margin: float) -> None:
        x = np.linspace(start, end, 16)
        w = np.interp(x, body.x, body.roof_half_width)
        p.polygon("top", _curve(x, w - margin + 0.035) + _curve(x[::-1], -(w - margin + 0.035)[::-1]), _RUBBER)
        p.polygon("top", _curve(x, w - margin) + _curve(x[::-1], -(w - margin)[::-1]), _PANE)

    pane(shape.roof_front + 0.03, shape.cowl[0] - 0.02, 0.075)
    if shape.kind != "truck":
        pane(max(shape.rear_glass[0], -half + TAIL_M) + 0.05, shape.roof_rear - 0.04, 0.10)
    x = np.linspace(shape.cowl[0] + 0.05, half - 0.18, 20)
    edge = np.interp(x, body.x, body.roof_half_width)
    for sign in (1.0, -1.0):
        p.line("top", _curve(x, sign * (edge - 0.05)), _SEAM, 2)
        p.line("top", _curve(x, sign * 0.55 * edge), (228, 228, 228, TINTED), 2)
        p.polygon(
            "top",
            [
                (half - 0.1, sign * 0.42),
                (half - 0.19, sign * 0.45),
                (half - 0.36, sign * 0.86),
                (half - 0.1, sign * 0.92),
            ],
            _LAMP,
        )
    w = float(np.interp(shape.cowl[0], body.x, body.roof_half_width))
    cowl = shape.cowl[0]
    p.polygon(
        "top",
        [(cowl - 0.03, w - 0.05), (cowl + 0.05, w - 0.05), (cowl + 0.05, 0.05 - w), (cowl - 0.03, 0.05 - w)],
        _PLASTIC,
    )
    for y in (-0.35, 0.25):
        p.line("top", [(cowl - 0.03, y), (cowl - 0.10, y + 0.42)], _RUBBER, 3)
    if shape.kind == "pickup":
        bed = (-half + 0.10, shape.rear_glass[0] - 0.06)
        w = float(np.interp(np.mean(bed), body.x, body.roof_half_width)) - 0.02
        p.polygon("top", [(bed[0], -w), (bed[1], -w), (bed[1], w), (bed[0], w)], _PLASTIC)
    elif not shape.steep_tail and shape.kind != "truck":
        start = shape.rear_glass[0] - 0.04
        w = float(np.interp(start, body.x, body.roof_half_width))
        p.line("top", [(start, -w), (start, w)], _SEAM, 2)
    if shape.rails:
        x = np.linspace(shape.roof_rear + 0.1, shape.roof_front - 0.1, 12)
        rail = np.interp(x, body.x, body.roof_half_width)
        for sign in (1.0, -1.0):
            p.line("top", _curve(x, sign * (rail - 0.10)), _CHROME if shape.kind == "estate" else _RUBBER, 6)


def _paint_front(p: CarPainter, rng: np.random.Generator) -> None:
    shape = p.shape
    w, nose = shape.width / 2, shape.nose
    p.polygon("front", [(-w, shape.sill + 0.06), (w, shape.sill + 0.06), (w, 0), (-w, 0)], _PLASTIC)
    grille = rng.uniform(0.26, 0.44) * w / 0.9
    height = rng.uniform(0.12, 0.22) + (0.08 if shape.kind in ("suv", "pickup", "truck", "van") else 0.0)
    top = nose - 0.01
    p.polygon(
        "front", [(-grille, top), (grille, top), (grille * 0.9, top - height), (-grille * 0.9, top - height)], _PLASTIC
    )
    for z in np.arange(top - 0.03, top - height, -0.035):
        p.line(
            "front",
            [(-grille * 0.95, float(z)), (grille * 0.95, float(z))],
            _CHROME if rng.random() < 0.5 else (70, 71, 74, MATTE),
            1,
        )
    p.line("front", [(-grille, top), (grille, top)], _CHROME, 2)
    p.ellipse("front", (0.0, top - 0.07), (0.055, 0.05), _CHROME)
    inner, slant = grille + 0.05, rng.uniform(0.02, 0.08)
    for sign in (1.0, -1.0):
        rim = [
            (sign * inner, nose - 0.11),
            (sign * (inner + 0.03), nose + 0.01),
            (sign * w, nose + slant),
            (sign * w, nose - 0.15),
        ]
        lens = [
            (sign * (inner + 0.03), nose - 0.095), (sign * (inner + 0.05), nose - 0.005),
            (sign * (w - 0.05), nose + slant - 0.02), (sign * (w - 0.05), nose - 0.13),
        ]  # fmt: skip
        p.polygon("front", rim, _LAMP_RIM)
        p.polygon("front", lens, _LAMP)
        middle = sign * (inner + w) / 2
        p.ellipse("front", (middle, nose - 0.06), (0.055, 0.05), (94, 98, 104, GLASS))
        p.ellipse("front", (middle, nose - 0.06), (0.030, 0.028), (228, 230, 232, GLASS))
        fog = sign * (w - 0.24)
        p.polygon("front", [(fog - 0.09, 0.47), (fog + 0.09, 0.47), (fog + 0.07, 0.36), (fog - 0.07, 0.36)], _RUBBER)
        p.ellipse("front", (fog, 0.415), (0.035, 0.035), _LAMP)
    p.polygon("front", [(-0.56, 0.45), (0.56, 0.45), (0.48, 0.29), (-0.48, 0.29)], _RUBBER)
    p.line("front", [(-w, 0.53), (w, 0.53)], _SEAM, 1)
    _paint_plate(p, "front", 0.52, rng)


def _paint_rear(p: CarPainter, rng: np.random.Generator) -> None:
    shape = p.shape
    w, tail = shape.width / 2, shape.tail
    p.polygon("rear", [(-w, shape.sill + 0.12), (w, shape.sill + 0.12), (w, 0), (-w, 0)], _PLASTIC)
    if shape.kind in ("van", "truck", "pickup", "suv"):
        high = shape.sill + 0.36
        p.polygon("rear", [(-w, high), (w, high), (w, 0), (-w, 0)], _PLASTIC)
    if shape.kind == "van":
        p.line("rear", [(0.0, shape.sill + 0.36), (0.0, shape.height)], _SEAM, 3)
    if shape.steep_tail:
        glass = shape.rear_glass[1]
        p.polygon(
            "rear",
            [(-w * 0.74, glass + 0.01), (w * 0.74, glass + 0.01), (w * 0.6, shape.height), (-w * 0.6, shape.height)],
            _PANE,
        )
    tall = shape.kind in ("van", "minivan", "estate", "truck") and rng.random() < 0.7
    inner = w * (0.72 if tall or shape.steep_tail else 0.52)
    high, low = (tail + 0.12, tail - 0.32) if tall else (tail - 0.01, tail - 0.20)
    for sign in (1.0, -1.0):
        p.polygon(
            "rear",
            [(sign * inner, high - 0.02), (sign * w, high), (sign * w, low - 0.04), (sign * inner, low + 0.02)],
            _TAIL_LAMP,
        )
        middle = (high + low) / 2
        p.polygon(
            "rear",
            [
                (sign * (inner + 0.04), middle),
                (sign * (w - 0.08), middle),
                (sign * (w - 0.08), middle - 0.05),
                (sign * (inner + 0.04), middle - 0.04),
            ],
            _REVERSING,
        )
    lid, bumper = inner - 0.02, 0.54
    p.line("rear", [(-lid, tail + 0.02), (-lid, bumper), (lid, bumper), (lid, tail + 0.02)], _GAP, 3)
    p.line("rear", [(-w, bumper), (w, bumper)], _GAP, 3)
    p.line("rear", [(-w, bumper - 0.02), (w, bumper - 0.02)], _CREASE, 2)
    p.polygon("rear", [(-w * 0.62, 0.40), (w * 0.62, 0.40), (w * 0.55, 0.24), (-w * 0.55, 0.24)], _PLASTIC)
    for sign in (1.0, -1.0):
        a, b = sign * w * 0.70, sign * w * 0.90
        p.polygon("rear", [(a, 0.44), (b, 0.44), (b, 0.405), (a, 0.405)], _TAIL_LAMP)
    p.polygon("rear", [(-0.28, tail - 0.04), (0.28, tail - 0.04), (0.28, tail - 0.06), (-0.28, tail - 0.06)], _CHROME)
    p.ellipse("rear", (0.0, tail - 0.02), (0.05, 0.045), _CHROME)
    _paint_plate(p, "rear", (tail - 0.11) if rng.random() < 0.6 else 0.64, rng)


def _paint_plate(p: CarPainter, region: str, top: float, rng: np.random.Generator) -> None:
    p.polygon(region, [(-0.27, top), (0.27, top), (0.27, top - 0.12), (-0.27, top - 0.12)], _PLATE)
    for x in np.linspace(-0.22, 0.19, 7):
        if rng.random() < 0.85:
            a, b = float(x), float(x) + 0.038
            p.polygon(region, [(a, top - 0.025), (b, top - 0.025), (b, top - 0.095), (a, top - 0.095)], _PLATE_INK)
            cut = top - float(rng.uniform(0.04, 0.07))
            p.line(region, [(a + 0.01, cut), (b, cut)], _PLATE, 1)


def _paint_wheel(p: CarPainter, rng: np.random.Generator) -> None:
    size = p.size
    left, top, right, bottom = (int(v * size) for v in (0.8, 0.74, 1.0, 1.0))
    tile = p.texture[top:bottom, left:right]
    tile[:] = _RUBBER
    centre = ((right - left) // 2, (bottom - top) // 2)
    r = min(centre) - 2
    steel = rng.random() < 0.25
    rim: Colour = (96, 97, 100, MATTE) if steel else (158, 160, 164, MATTE)
    cv2.circle(tile, centre, int(0.70 * r), (30, 30, 31, MATTE), -1)
    spokes = int(rng.choice([5, 5, 6, 7, 10]))
    for i in range(spokes):
        for split in (-0.11, 0.11) if spokes < 7 else (0.0,):
            a = 2 * np.pi * i / spokes + split
            end = (round(centre[0] + 0.66 * r * np.cos(a)), round(centre[1] + 0.66 * r * np.sin(a)))
            cv2.line(tile, centre, end, rim, max(3 * _OVERSAMPLED, int(0.10 * r)))
    if steel:
        cv2.circle(tile, centre, int(0.52 * r), rim, -1)
    cv2.circle(tile, centre, int(0.68 * r), rim, 4 * _OVERSAMPLED)
    cv2.circle(tile, centre, int(0.16 * r), rim, -1)
    cv2.circle(tile, centre, int(0.07 * r), (60, 60, 62, MATTE), -1)
