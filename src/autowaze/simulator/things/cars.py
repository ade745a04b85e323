"""Complete cars: body, wheels, mirrors, underbody, with a coarse twin for the distance."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.mesh import Mesh, box, ellipsoid, grid_faces
from autowaze.simulator.things.car_body import ATLAS_REGIONS, atlas_uv, body_mesh, loft
from autowaze.simulator.things.car_paint import paint_car
from autowaze.simulator.things.car_shapes import CarShape, styled

# (weight, hue, saturation, value, spread) after the paint makers' yearly colour reports: most cars are grey
_PAINTS = [
    (0.17, 0.0, 0.01, 0.90, 0.04), (0.18, 0.6, 0.05, 0.11, 0.03), (0.17, 0.6, 0.04, 0.36, 0.09),
    (0.14, 0.6, 0.03, 0.64, 0.07), (0.14, 0.61, 0.70, 0.38, 0.13), (0.09, 0.995, 0.82, 0.50, 0.12),
    (0.04, 0.38, 0.55, 0.28, 0.08), (0.04, 0.09, 0.35, 0.50, 0.12), (0.01, 0.13, 0.80, 0.75, 0.06),
    (0.02, 0.55, 0.55, 0.62, 0.08),
]  # fmt: skip

_TYRE_PROFILE = [
    (0.0, 0.0),
    (0.12, -0.005),
    (0.60, -0.035),
    (0.66, -0.005),
    (0.72, 0.004),
    (0.94, 0.0),
    (1.0, -0.03),
    (1.0, -0.20),
]


@dataclass(frozen=True)
class CarModel:
    """One make and body: near and far mesh, texture, size."""

    name: str
    shape: CarShape
    near: Mesh
    far: Mesh
    texture: NDArray[np.uint8]


@lru_cache(maxsize=64)
def car_model(kind: str, style: int) -> CarModel:
    """The car of a kind in one of many styles."""
    rng = np.random.default_rng([style, *kind.encode()])
    shape = styled(kind, rng)
    body = loft(shape)
    texture = paint_car(body, rng)
    near = Mesh.concatenate([body_mesh(body), *_wheels(shape, 18), *_mirrors(shape), *_chassis(shape)])
    far = Mesh.concatenate([body_mesh(loft(shape, detail=1)), *_wheels(shape, 8), *_chassis(shape)])
    return CarModel(f"{kind}-{style}", shape, near, far, texture)


def paint_colour(rng: np.random.Generator, kind: str) -> tuple[int, int, int]:
    """A car's colour, RGB; vans and trucks are mostly white."""
    weights = np.array([p[0] for p in _PAINTS])
    if kind in ("van", "truck"):
        weights[0] += 1.0
    _, hue, saturation, value, spread = _PAINTS[int(rng.choice(len(_PAINTS), p=weights / weights.sum()))]
    value = float(np.clip(value + rng.normal(0.0, spread), 0.06, 0.94))
    saturation = float(np.clip(saturation * rng.uniform(0.85, 1.15), 0.0, 1.0))
    r, g, b = colorsys.hsv_to_rgb((hue + rng.normal(0.0, 0.012)) % 1.0, saturation, value)
    return round(255 * r), round(255 * g), round(255 * b)


def _wheels(shape: CarShape, sides: int) -> list[Mesh]:
    left, top, right, bottom = ATLAS_REGIONS["wheel"]
    middle = np.array([(left + right) / 2, (top + bottom) / 2])
    reach = 0.5 * np.array([right - left, right - left]) * 0.97
    angle = np.linspace(0.0, 2 * np.pi, sides + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    radius = np.array([r for r, _ in _TYRE_PROFILE])
    depth = np.array([d for _, d in _TYRE_PROFILE])
    tread = (radius > 0.97)[:, None, None]
    uv = middle + reach * np.minimum(radius, 0.96)[:, None, None] * ring
    wheels = []
    for axle in (shape.front_axle, shape.rear_axle):
        for sign in (1.0, -1.0):
            outside = sign * (float(shape.half_width(np.array(axle))) - 0.012)
            position = np.stack(
                np.broadcast_arrays(
                    axle + shape.wheel_radius * radius[:, None] * ring[:, 0],
                    outside + sign * depth[:, None],
                    shape.wheel_radius * (1 + radius[:, None] * ring[:, 1]),
                ),
                -1,
            )
            flat = np.broadcast_to([0.0, sign, 0.0], position.shape)
            round_ = np.stack(np.broadcast_arrays(ring[:, 0], 0.25 * sign, ring[:, 1]), -1)[None]
            normal = np.where(tread, round_, flat)
            normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
            faces = grid_faces(len(radius), sides + 1)
            faces = faces[:, ::-1] if sign > 0 else faces
            wheels.append(
                Mesh.of(position.reshape(-1, 3), normal.reshape(-1, 3), uv.reshape(-1, 2), faces, (255, 255, 255, 190))
            )
    return wheels


def _mirrors(shape: CarShape) -> list[Mesh]:
    x = shape.cowl[0] - 0.30
    z = float(shape.belt(np.array(x))) + 0.09
    y = float(shape.half_width(np.array(x))) + 0.075
    paint = atlas_uv(shape, "top", np.array([[(shape.roof_front + shape.roof_rear) / 2, 0.0, shape.height]]))[0]
    parts = []
    for sign in (1.0, -1.0):
        mirror = ellipsoid((x, sign * y, z), (0.065, 0.115, 0.075), 9, 6)
        parts.append(Mesh.of(mirror.position, mirror.normal, paint, mirror.faces))
    return parts


def _chassis(shape: CarShape) -> list[Mesh]:
    half, w = shape.length / 2, shape.width / 2
    dark = atlas_uv(shape, "underside", np.zeros((1, 3)))[0]
    under = box((-half + 0.25, -w + 0.26, shape.sill - 0.03), (half - 0.25, w - 0.26, 0.62))
    parts = [Mesh.of(under.position, under.normal, dark, under.faces, (255, 255, 255, 110))]
    if shape.cargo:
        front, width, height = shape.cargo
        cargo = box((-half - 0.02, -width / 2, 0.78), (front, width / 2, height))
        paint = atlas_uv(shape, "top", np.array([[(shape.roof_front + shape.roof_rear) / 2, 0.0, 1.0]]))[0]
        parts.append(Mesh.of(cargo.position, cargo.normal, paint, cargo.faces))
    return parts
