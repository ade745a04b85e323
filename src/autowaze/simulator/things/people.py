"""People on foot."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from autowaze.simulator.mesh import Mesh, ellipsoid, shifted, tube

WALK_PHASES = 8
STRIDE_M = 1.45
OUTFITS = 8
PERSON_SIZE = (0.55, 0.55, 1.76)

Point = tuple[float, float, float]

_SKINS = [(224, 180, 150), (198, 150, 118), (150, 104, 78), (96, 66, 50)]
_CLOTHES = [
    (40, 44, 58),
    (150, 40, 44),
    (210, 206, 198),
    (64, 84, 66),
    (36, 36, 38),
    (60, 90, 140),
    (176, 150, 110),
    (120, 60, 100),
    (214, 168, 60),
]
_HAIR = [(38, 28, 22), (90, 64, 40), (160, 130, 80), (150, 150, 150), (20, 18, 18)]


def walker(outfit: int, phase: float) -> Mesh:
    """A person walking towards +x, 1.76 m tall; `phase` 0..1 through the stride."""
    swing = np.sin(2 * np.pi * phase)
    legs = [_leg(side, side * swing, 2 * np.pi * phase + (0 if side > 0 else np.pi)) for side in (1.0, -1.0)]
    return _figure(outfit, legs, (-swing, swing))


def rider(outfit: int, lift: float) -> Mesh:
    """A person on a bicycle's saddle at height `lift`, feet on the pedals."""
    legs: list[list[Point]] = [
        [(-0.12, 0.10, lift), (0.26, 0.13, lift - 0.18), (0.12, 0.12, lift - 0.55)],
        [(-0.12, -0.10, lift), (0.20, -0.13, lift - 0.36), (0.02, -0.12, lift - 0.75)],
    ]
    return _figure(outfit, legs, None, lift - 0.92, lean=0.30)


def _leg(side: float, swing: float, angle: float) -> list[Point]:
    lifted = max(0.0, float(np.cos(angle))) * 0.10
    foot = 0.34 * swing
    knee = 0.5 * foot + 0.05 + 0.5 * lifted
    return [
        (0.0, side * 0.09, 0.92),
        (knee, side * 0.10, 0.49 + 0.3 * lifted),
        (foot - 0.6 * lifted, side * 0.10, 0.06 + lifted),
    ]


@lru_cache(maxsize=OUTFITS)
def _colours(outfit: int) -> tuple[tuple[int, int, int], ...]:
    rng = np.random.default_rng([outfit, 31])
    palettes = (_SKINS, _CLOTHES, _CLOTHES, _HAIR)
    return tuple(palette[int(rng.integers(0, len(palette)))] for palette in palettes)


def _figure(
    outfit: int, legs: list[list[Point]], arms: tuple[float, float] | None, lift: float = 0.0, lean: float = 0.04
) -> Mesh:
    skin, top, trousers, hair = ((*c, 255) for c in _colours(outfit))
    shoulder = np.array([lean * 0.9, 0.0, 1.44 + lift - 0.25 * lean])
    hip = np.array([-0.12 if arms is None else 0.0, 0.0, 0.95 + lift])
    parts = []
    for joints in legs:
        a, b, c = (np.array(j) for j in joints)
        parts += [tube(a, b, 0.092, 0.066, 8, trousers), tube(b, c, 0.066, 0.046, 8, trousers)]
        parts.append(ellipsoid(shifted(c, 0.07, 0, -0.01), (0.14, 0.052, 0.05), 8, 5, (30, 28, 28, 255)))
    chest = hip + 0.62 * (shoulder - hip)
    parts.append(ellipsoid(shifted(hip, 0, 0, 0.02), (0.13, 0.175, 0.14), 10, 7, trousers))
    parts.append(ellipsoid(shifted(chest, 0, 0, -0.06), (0.135, 0.19, 0.24), 10, 8, top))
    parts.append(ellipsoid(shifted(shoulder, 0, 0, -0.05), (0.105, 0.215, 0.11), 10, 7, top))
    for side, swing in zip((1.0, -1.0), arms or (0.0, 0.0), strict=True):
        a = shifted(shoulder, 0.0, side * 0.205, -0.04)
        if arms is None:
            b, c = shifted(a, 0.24, side * 0.06, -0.18), shifted(a, 0.44, side * 0.02, -0.26)
        else:
            b, c = shifted(a, 0.16 * swing, side * 0.03, -0.28), shifted(a, 0.30 * swing + 0.06, side * 0.03, -0.53)
        parts += [tube(a, b, 0.056, 0.046, 7, top), tube(b, c, 0.046, 0.036, 7, top)]
        parts.append(ellipsoid(shifted(c, 0.01, 0, -0.03), (0.045, 0.035, 0.06), 7, 5, skin))
    head = shifted(shoulder, 0.05 + 0.2 * lean, 0.0, 0.21)
    parts.append(tube(shoulder, head, 0.055, 0.055, 8, skin))
    parts.append(ellipsoid(shifted(head, 0.01, 0, 0.0), (0.095, 0.078, 0.118), 10, 8, skin))
    parts.append(ellipsoid(shifted(head, -0.022, 0, 0.035), (0.095, 0.086, 0.105), 10, 8, hair))
    return Mesh.concatenate(parts)
