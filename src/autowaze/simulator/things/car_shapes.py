"""Body kinds of cars: the numbers behind their silhouettes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator


@dataclass(frozen=True)
class CarShape:
    """Side profile and proportions, metres; x forward from the middle, z up from the ground.

    Attributes:
        cowl: where windscreen and bonnet meet (x, z).
        roof_front, roof_rear: ends of the roof, x.
        rear_glass: foot of the rear window (x, z).
        nose, tail: heights of the edges of bonnet and boot.
        pillars: x of the pillars that part the side windows, from the rear.
        blind_rear: no side windows behind the last pillar (a panel van).
        cargo: front x, width and height of a box on the chassis, for trucks.
    """

    kind: str
    length: float
    width: float
    height: float
    nose: float
    cowl: tuple[float, float]
    roof_front: float
    roof_rear: float
    rear_glass: tuple[float, float]
    tail: float
    wheel_radius: float
    wheelbase: float
    front_overhang: float
    sill: float
    pillars: tuple[float, ...]
    blind_rear: bool = False
    tumblehome: float = 0.36
    rails: bool = False
    cargo: tuple[float, float, float] | None = None

    @property
    def front_axle(self) -> float:
        """x of the front wheels."""
        return self.length / 2 - self.front_overhang

    @property
    def rear_axle(self) -> float:
        """x of the rear wheels."""
        return self.front_axle - self.wheelbase

    @property
    def steep_tail(self) -> bool:
        """Whether the rear window reaches the tail, as on a hatchback."""
        return self.rear_glass[0] + self.length / 2 < 0.3

    @property
    def overall_height(self) -> float:
        """Height of the highest part."""
        return max(self.height, self.cargo[2]) if self.cargo else self.height

    def top(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height of the outline above the middle of the car."""
        half, height = self.length / 2, self.height
        (cowl_x, cowl_z), (glass_x, glass_z) = self.cowl, self.rear_glass
        middle = (self.roof_front + self.roof_rear) / 2
        above_glass = glass_z + 0.56 * (height - 0.05 - glass_z)
        above_cowl = cowl_z + 0.56 * (height - 0.04 - cowl_z)
        if self.steep_tail:
            rear = [(-half, self.tail - 0.2), (-half + 0.05, self.tail - 0.02), (max(glass_x, -half + 0.09), glass_z)]
        else:
            boot = min(self.tail, glass_z)
            rear = [(-half, self.tail - 0.2), (-half + 0.04, self.tail - 0.1), (-half + 0.14, boot), (glass_x, glass_z)]
        bonnet = min((cowl_x + half) / 2 + 0.1, half - 0.30)
        line = [
            *rear,
            ((rear[-1][0] + self.roof_rear) / 2, above_glass),
            (self.roof_rear, height - 0.05),
            (middle, height),
            (self.roof_front, height - 0.04),
            ((cowl_x + self.roof_front) / 2, above_cowl),
            (cowl_x, cowl_z),
            (bonnet, cowl_z - 0.3 * (cowl_z - self.nose)),
            (half - 0.22, self.nose + 0.06),
            (half - 0.05, self.nose - 0.03),
            (half, self.nose - 0.16),
        ]
        xs, zs = np.array(line).T
        return np.asarray(PchipInterpolator(xs, zs)(x))

    def belt(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height of the line under the side windows."""
        (cowl_x, cowl_z), (glass_x, glass_z) = self.cowl, self.rear_glass
        return np.asarray(cowl_z - 0.03 + (glass_z - cowl_z) * (cowl_x - x) / (cowl_x - glass_x))

    def half_width(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Half the width of the body, narrowing towards the ends."""
        u = np.abs(x) / (self.length / 2)
        return np.asarray(self.width / 2 * (1 - 0.04 * u**2 - 0.16 * np.clip((u - 0.82) / 0.18, 0, 1) ** 2.2))

    def lower_edge(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height of the sill, cut out over the wheels."""
        u = np.abs(x) / (self.length / 2)
        edge = self.sill + 0.08 * np.clip((u - 0.75) / 0.25, 0, 1) ** 1.5
        reach = self.wheel_radius + 0.055
        for axle in (self.front_axle, self.rear_axle):
            inside = reach**2 - (x - axle) ** 2
            edge = np.where(inside > 0, np.maximum(edge, self.wheel_radius + np.sqrt(np.maximum(inside, 0))), edge)
        return np.asarray(edge)


_SHAPES = (
    CarShape(
        "city", 3.55, 1.63, 1.49, 0.78, (0.95, 1.00), 0.35, -1.30, (-1.66, 1.02), 0.92, 0.285, 2.38, 0.66, 0.19,
        (-0.42,),
    ),
    CarShape(
        "hatch", 4.10, 1.76, 1.47, 0.74, (0.98, 0.98), 0.28, -1.35, (-1.90, 1.02), 0.92, 0.31, 2.56, 0.83, 0.19,
        (-0.45,),
    ),
    CarShape(
        "sedan", 4.62, 1.80, 1.45, 0.72, (1.00, 0.97), 0.18, -0.98, (-1.66, 1.04), 1.00, 0.325, 2.72, 0.88, 0.19,
        (-0.42,),
    ),
    CarShape(
        "estate", 4.68, 1.81, 1.48, 0.73, (1.02, 0.98), 0.25, -1.75, (-2.20, 1.03), 0.94, 0.325, 2.74, 0.88, 0.19,
        (-0.42, -1.32), rails=True,
    ),
    CarShape(
        "suv", 4.48, 1.86, 1.69, 0.90, (1.00, 1.13), 0.38, -1.65, (-2.08, 1.19), 1.05, 0.365, 2.68, 0.86, 0.27,
        (-0.40, -1.30), rails=True,
    ),
    CarShape(
        "minivan", 4.45, 1.84, 1.65, 0.84, (1.28, 1.06), 0.52, -1.72, (-2.10, 1.10), 1.00, 0.32, 2.76, 0.86, 0.20,
        (-0.20, -1.15),
    ),
    CarShape(
        "van", 5.00, 1.94, 1.95, 1.00, (1.72, 1.22), 0.95, -2.20, (-2.40, 1.22), 1.05, 0.34, 3.05, 0.94, 0.23,
        (0.28,), True, 0.20,
    ),
    CarShape(
        "pickup", 5.25, 1.87, 1.80, 0.98, (1.15, 1.17), 0.55, -0.62, (-0.86, 1.20), 1.14, 0.385, 3.15, 0.92, 0.33,
        (-0.05,),
    ),
    CarShape(
        "sports", 4.40, 1.83, 1.29, 0.64, (0.85, 0.90), 0.05, -0.75, (-1.72, 0.97), 0.90, 0.335, 2.55, 0.90, 0.15,
        (-0.55,),
    ),
    CarShape(
        "truck", 6.00, 2.02, 2.20, 1.22, (2.55, 1.36), 2.02, 1.12, (1.02, 1.35), 0.92, 0.38, 3.40, 0.98, 0.36, (),
        tumblehome=0.15, cargo=(0.92, 2.12, 2.95),
    ),
)  # fmt: skip

SHAPES = {shape.kind: shape for shape in _SHAPES}

SHARES = {
    "city": 0.10, "hatch": 0.24, "sedan": 0.16, "estate": 0.14, "suv": 0.18, "minivan": 0.06, "van": 0.06,
    "pickup": 0.03, "sports": 0.02, "truck": 0.01,
}  # fmt: skip
"""How common each kind is at a kerb."""


def styled(kind: str, rng: np.random.Generator) -> CarShape:
    """A make's own version of a body kind."""
    base = SHAPES[kind]
    stretch, rise = rng.uniform(0.97, 1.03), rng.normal(0.0, 0.012)
    return replace(
        base,
        length=base.length * stretch,
        nose=base.nose + rng.normal(0.0, 0.02),
        cowl=(base.cowl[0] * stretch + rng.normal(0.0, 0.03), base.cowl[1] + rise),
        roof_front=base.roof_front * stretch + rng.normal(0.0, 0.03),
        roof_rear=base.roof_rear * stretch,
        rear_glass=(base.rear_glass[0] * stretch, base.rear_glass[1] + rise + rng.uniform(-0.02, 0.03)),
        wheelbase=base.wheelbase * stretch,
        front_overhang=base.front_overhang * stretch,
        pillars=tuple(p * stretch for p in base.pillars),
        cargo=base.cargo,
    )
