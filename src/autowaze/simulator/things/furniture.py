"""Street furniture: lamps, signs, bins, bollards, cones, barriers, cabinets, bicycle stands."""

from __future__ import annotations

from autowaze.simulator.mesh import Mesh, box, quads, revolved, tube
from autowaze.simulator.scene import Model

SIGN_CELLS = {"parking": 0, "stop": 1, "speed": 2, "give way": 3}


def lamp() -> Model:
    """A street lamp of 6 m with an arm towards +x."""
    pole = [revolved([0.09, 0.09, 0.055, 0.05], [0, 0.9, 1.0, 5.8], 10, tint=(96, 100, 102, 255))]
    pole.append(tube((0, 0, 5.75), (1.3, 0, 6.05), 0.04, 0.035, 6, (96, 100, 102, 255)))
    head = box((1.0, -0.12, 6.02), (1.65, 0.12, 6.13), 1.0, (84, 88, 90, 255))
    glass = quads(
        [[(1.05, -0.09, 6.01), (1.05, 0.09, 6.01), (1.60, 0.09, 6.01), (1.60, -0.09, 6.01)]],
        [(0, 0), (1, 0), (1, 1), (0, 1)],
    )
    return Model(((Mesh.concatenate([*pole, head]), "metal"), (glass, "lamp")))


def sign(kind: str) -> Model:
    """A traffic sign on a post, facing -y."""
    post = revolved([0.032, 0.032], [0.0, 2.75], 8, tint=(150, 152, 154, 255))
    cell = SIGN_CELLS[kind]
    left, right = cell / 4 + 0.002, (cell + 1) / 4 - 0.002
    face = quads(
        [[(-0.31, -0.045, 2.1), (0.31, -0.045, 2.1), (0.31, -0.045, 2.72), (-0.31, -0.045, 2.72)]],
        [(left, 1), (right, 1), (right, 0), (left, 0)],
    )
    return Model(((post, "metal"), (face, "signs")))


def bin_on_wheels() -> Model:
    """A household bin."""
    body = _tapered((0.25, 0.28), (0.29, 0.33), 0.12, 0.98)
    lid = box((-0.31, -0.37, 0.98), (0.31, 0.34, 1.06), 1.0)
    wheels = [
        tube((x - 0.03, 0.26, 0.11), (x + 0.03, 0.26, 0.11), 0.11, sides=10, tint=(30, 30, 30, 255))
        for x in (-0.27, 0.27)
    ]
    return Model(((Mesh.concatenate([body, lid, *wheels]), "plain"),))


def litter_bin() -> Model:
    """A public bin on a post."""
    body = revolved([0.0, 0.21, 0.23, 0.23, 0.17], [0.35, 0.36, 0.8, 1.02, 1.06], 12, tint=(70, 84, 74, 255))
    post = revolved([0.04, 0.04], [0, 0.4], 6, tint=(70, 72, 74, 255))
    return Model(((Mesh.concatenate([body, post]), "metal"),))


def bollard() -> Model:
    """An iron bollard with a light band."""
    body = revolved(
        [0.075, 0.065, 0.065, 0.085, 0.08, 0.0], [0, 0.1, 0.85, 0.88, 0.97, 1.02], 10, tint=(52, 54, 56, 255)
    )
    band = revolved([0.069, 0.069], [0.68, 0.78], 10, tint=(228, 226, 220, 255))
    return Model(((Mesh.concatenate([body, band]), "metal"),))


def cone() -> Model:
    """A traffic cone of 75 cm with two white bands."""
    foot = box((-0.21, -0.21, 0.0), (0.21, 0.21, 0.035), 1.0, (205, 74, 24, 255))
    bands = [
        (0.0, 0.3, (226, 80, 22)),
        (0.3, 0.46, (238, 236, 230)),
        (0.46, 0.6, (226, 80, 22)),
        (0.6, 0.8, (238, 236, 230)),
        (0.8, 1.0, (226, 80, 22)),
    ]
    parts = [foot]
    for a, b, colour in bands:
        parts.append(
            revolved([0.15 - 0.125 * a, 0.15 - 0.125 * b], [0.035 + 0.7 * a, 0.035 + 0.7 * b], 12, tint=(*colour, 255))
        )
    return Model(((Mesh.concatenate(parts), "plain"),))


def barrier() -> Model:
    """A striped works barrier along x."""
    planks = []
    for i in range(8):
        colour = (222, 60, 34) if i % 2 else (236, 234, 228)
        x0 = -1.0 + 0.25 * i
        planks.append(box((x0, -0.02, 0.78), (x0 + 0.25, 0.02, 1.0), 1.0, (*colour, 255)))
    legs = [box((x - 0.03, -0.22, 0.0), (x + 0.03, 0.22, 0.05), 1.0, (60, 60, 62, 255)) for x in (-0.8, 0.8)]
    posts = [box((x - 0.025, -0.025, 0.0), (x + 0.025, 0.025, 1.05), 1.0, (90, 92, 94, 255)) for x in (-0.8, 0.8)]
    return Model(((Mesh.concatenate([*planks, *legs, *posts]), "plain"),))


def cabinet() -> Model:
    """A grey switch cabinet."""
    body = box((-0.5, -0.18, 0.0), (0.5, 0.18, 1.15), 1.0, (150, 154, 150, 255))
    roof = box((-0.53, -0.21, 1.15), (0.53, 0.21, 1.20), 1.0, (128, 132, 128, 255))
    seam = box((-0.005, -0.19, 0.1), (0.005, -0.18, 1.1), 1.0, (80, 82, 80, 255))
    return Model(((Mesh.concatenate([body, roof, seam]), "plain"),))


def bench() -> Model:
    """A slatted bench, its back to +y."""
    slats = [
        box((-0.8, -0.22 + 0.11 * i, 0.44), (0.8, -0.14 + 0.11 * i, 0.48), 1.0, (150, 108, 70, 255)) for i in range(4)
    ]
    back = [
        box((-0.8, 0.24, 0.58 + 0.14 * i), (0.8, 0.28, 0.67 + 0.14 * i), 1.0, (150, 108, 70, 255)) for i in range(2)
    ]
    legs = [box((x - 0.03, -0.2, 0), (x + 0.03, 0.27, 0.44), 1.0, (60, 62, 64, 255)) for x in (-0.65, 0.65)]
    return Model(((Mesh.concatenate([*slats, *back, *legs]), "plain"),))


def _tapered(foot: tuple[float, float], top: tuple[float, float], z0: float, z1: float) -> Mesh:
    """A box that widens upwards."""
    low = [(-foot[0], -foot[1], z0), (foot[0], -foot[1], z0), (foot[0], foot[1], z0), (-foot[0], foot[1], z0)]
    high = [(-top[0], -top[1], z1), (top[0], -top[1], z1), (top[0], top[1], z1), (-top[0], top[1], z1)]
    sides = [[low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]] for i in range(4)]
    return quads([*sides, low[::-1]], [(0, 1), (1, 1), (1, 0), (0, 0)])
