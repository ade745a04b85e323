"""Bicycles and motorcycles, along +x."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.mesh import Mesh, box, ellipsoid, grid_faces, shifted, tube

BICYCLE_SIZE = (1.75, 0.55, 1.05)
CYCLIST_SIZE = (1.75, 0.60, 1.80)
MOTORCYCLE_SIZE = (2.1, 0.75, 1.2)
SADDLE_M = 1.0

_BLACK = (28, 28, 29, 255)
_METAL = (150, 152, 156, 255)
_WHITE = (255, 255, 255, 255)


def bicycle() -> Mesh:
    """A city bicycle; its frame takes the tint of the thing."""
    rear, front, crank = np.array([-0.53, 0, 0.34]), np.array([0.53, 0, 0.34]), np.array([-0.06, 0, 0.30])
    seat, head = np.array([-0.22, 0, 0.88]), np.array([0.38, 0, 0.86])
    parts = [_wheel(rear, 0.33, 0.017), _wheel(front, 0.33, 0.017)]
    for a, b in ((rear, crank), (rear, seat), (crank, seat), (crank, head * [1, 1, 0.92]), (seat * [1, 1, 0.93], head)):
        parts.append(tube(a, b, 0.018, sides=6, tint=_WHITE))
    parts += [
        tube(front, shifted(head, 0.0, 0, 0.12), 0.018, sides=6, tint=_METAL),
        tube(seat, shifted(seat, -0.03, 0, 0.12), 0.014, sides=6, tint=_METAL),
    ]
    bar = shifted(head, -0.02, 0, 0.14)
    parts.append(tube(shifted(bar, 0, -0.27, 0.02), shifted(bar, 0, 0.27, 0.02), 0.013, sides=6, tint=_METAL))
    parts.append(ellipsoid(shifted(seat, -0.03, 0, 0.14), (0.14, 0.075, 0.035), 9, 5, _BLACK))
    for angle in np.linspace(0, np.pi, 7)[:-1]:
        spoke = 0.32 * np.array([np.cos(angle), 0, np.sin(angle)])
        parts += [tube(hub - spoke, hub + spoke, 0.004, sides=3, tint=_METAL) for hub in (rear, front)]
    return Mesh.concatenate(parts)


def motorcycle() -> Mesh:
    """A naked motorcycle on its wheels."""
    rear, front = np.array([-0.70, 0, 0.31]), np.array([0.72, 0, 0.31])
    parts = [_wheel(rear, 0.26, 0.075), _wheel(front, 0.26, 0.062)]
    parts += [ellipsoid(hub, (0.19, 0.03, 0.19), 14, 5, _METAL) for hub in (rear, front)]
    parts.append(ellipsoid((0.02, 0, 0.46), (0.34, 0.16, 0.22), 10, 7, (70, 71, 74, 255)))
    parts.append(ellipsoid((0.18, 0, 0.80), (0.30, 0.15, 0.15), 12, 8, _WHITE))
    parts.append(ellipsoid((-0.38, 0, 0.80), (0.42, 0.13, 0.075), 12, 7, _BLACK))
    parts.append(ellipsoid((-0.72, 0, 0.78), (0.20, 0.10, 0.07), 10, 6, _WHITE))
    for side in (-0.09, 0.09):
        parts.append(tube(shifted(front, 0, side, 0), (0.46, side, 0.94), 0.03, sides=8, tint=_METAL))
        parts.append(tube(shifted(rear, 0, side, 0), (-0.10, side * 1.3, 0.42), 0.028, sides=6, tint=_BLACK))
    parts.append(tube((0.44, -0.36, 1.02), (0.44, 0.36, 1.02), 0.016, sides=6, tint=_BLACK))
    parts.append(ellipsoid((0.55, 0, 0.90), (0.08, 0.10, 0.10), 10, 7, (208, 210, 212, 255)))
    parts.append(tube((-0.05, 0.16, 0.36), (-0.85, 0.20, 0.46), 0.045, sides=8, tint=_METAL))
    parts.append(box((-0.95, -0.09, 0.55), (-0.92, 0.09, 0.68), 1.0, (226, 226, 218, 255)))
    return Mesh.concatenate(parts)


def _wheel(centre: NDArray[np.float64], radius: float, thickness: float) -> Mesh:
    """A tyre: a torus about the y axis."""
    around, tube_angle = np.linspace(0, 2 * np.pi, 25), np.linspace(0, 2 * np.pi, 7)
    a, t = np.meshgrid(around, tube_angle, indexing="ij")
    normal = np.stack([np.cos(t) * np.cos(a), np.sin(t), np.cos(t) * np.sin(a)], -1)
    ring = radius * np.stack([np.cos(a), np.zeros_like(a), np.sin(a)], -1)
    position = centre + ring + thickness * normal
    return Mesh.of(position.reshape(-1, 3), normal.reshape(-1, 3), (0.5, 0.5), grid_faces(25, 7), _BLACK)
