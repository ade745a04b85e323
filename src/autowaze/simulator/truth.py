"""What is really there: boxes, occupancy of every spot over time, and what each frame really sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from autowaze.simulator.plan.roads import Bay
from autowaze.simulator.scene import Thing
from autowaze.world.camera import StereoCamera
from autowaze.world.labels import VEHICLES
from autowaze.world.pose import Pose, inverse, transform

OCCUPIED_OVERLAP = 0.25
"""A spot is occupied while vehicles stand on at least this share of it."""
SEEN_RANGE_M = 25.0
SEEN_VACANT, SEEN_VEHICLE = 0.5, 0.25
"""A frame sees a vacant spot with half of it (ground to 0.8 m) in view, an occupied one with a quarter of its car."""
_OCCLUDED_M = 0.35
_SAMPLE_HEIGHTS_M = (0.02, 0.4, 0.8)


@dataclass(frozen=True)
class VehicleState:
    """A vehicle's box at one instant.

    Attributes:
        centre: (3,) middle of the box, map metres.
        heading_rad: where its front points, counter-clockwise from east.
    """

    id: int
    kind: str
    label: int
    centre: NDArray[np.float64]
    length: float
    width: float
    height: float
    heading_rad: float

    @property
    def footprint(self) -> Polygon:
        """Outline on the ground."""
        return Polygon(self.corners[:4, :2])

    @property
    def corners(self) -> NDArray[np.float64]:
        """(8, 3) corners, the lower four first."""
        signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) / 2
        along = np.array([np.cos(self.heading_rad), np.sin(self.heading_rad)])
        across = np.array([-along[1], along[0]])
        flat = self.centre[:2] + signs[:, :1] * self.length * along + signs[:, 1:] * self.width * across
        z = self.centre[2] + np.array([-0.5, 0.5]) * self.height
        return np.concatenate([np.column_stack([flat, np.full(4, v)]) for v in z])


def vehicle_state(thing: Thing, T_map_thing: NDArray[np.float64] | None = None) -> VehicleState:
    """The box of a vehicle where it stands, or at another pose."""
    T = thing.T_map_thing if T_map_thing is None else T_map_thing
    length, width, height = thing.size
    centre = T[:3, 3] + [0.0, 0.0, height / 2]
    return VehicleState(
        thing.id, thing.kind, int(thing.label), centre, length, width, height, float(np.arctan2(T[1, 0], T[0, 0]))
    )


def is_vehicle(thing: Thing) -> bool:
    """Whether a thing can occupy a spot."""
    return thing.label in VEHICLES


def occupying_vehicle(bay: Bay, vehicles: list[VehicleState]) -> int | None:
    """Id of the vehicle that stands on most of a spot, or None if it is vacant."""
    near = [v for v in vehicles if np.linalg.norm(v.centre[:2] - bay.centre) < bay.length_m + v.length]
    overlaps = [(bay.polygon.intersection(v.footprint).area / bay.polygon.area, v.id) for v in near]
    if sum(share for share, _ in overlaps) < OCCUPIED_OVERLAP:
        return None
    return max(overlaps)[1]


@dataclass(frozen=True)
class SpotView:
    """How much of a spot a frame sees: share of the ground, or of the vehicle on it, and the distance."""

    spot_id: str
    vehicle_id: int | None
    visible: float
    range_m: float

    @property
    def seen(self) -> bool:
        """Whether that is enough to tell its state."""
        threshold = SEEN_VACANT if self.vehicle_id is None else SEEN_VEHICLE
        return self.visible >= threshold and self.range_m <= SEEN_RANGE_M


def view_spots(
    bays: tuple[Bay, ...],
    vehicles: list[VehicleState],
    camera: StereoCamera,
    T_map_cam: Pose,
    ids: NDArray[np.uint32],
    depth: NDArray[np.float32],
) -> list[SpotView]:
    """What a rendered frame sees of every spot within range; needs the frame's ids and depth."""
    by_id = {v.id: v for v in vehicles}
    views = []
    for bay in bays:
        middle = transform(inverse(T_map_cam), np.array([[*bay.centre, 0.0]]))[0]
        range_m = float(np.hypot(middle[0], middle[2]))
        if range_m > SEEN_RANGE_M or middle[2] < -bay.length_m:
            continue
        occupant = occupying_vehicle(bay, vehicles)
        if occupant is None:
            visible = _visible_share(_spot_samples(bay), camera, T_map_cam, depth)
        else:
            visible = _visible_share(
                _facing_samples(by_id[occupant], T_map_cam), camera, T_map_cam, depth, ids == occupant
            )
        if visible > 0:
            views.append(SpotView(bay.id, occupant, round(visible, 3), round(range_m, 2)))
    return views


def _spot_samples(bay: Bay) -> NDArray[np.float64]:
    u, v = np.meshgrid(np.linspace(0.1, 0.9, 6), np.linspace(0.1, 0.9, 4))
    a, b, c, d = bay.corners
    flat = (
        ((1 - u) * (1 - v))[..., None] * a
        + (u * (1 - v))[..., None] * b
        + (u * v)[..., None] * c
        + ((1 - u) * v)[..., None] * d
    )
    flat = flat.reshape(-1, 2)
    return np.concatenate([np.column_stack([flat, np.full(len(flat), z)]) for z in _SAMPLE_HEIGHTS_M])


def _facing_samples(vehicle: VehicleState, T_map_cam: Pose) -> NDArray[np.float64]:
    """Points on the sides of the box that face the camera, a little inside where the body is."""
    samples = []
    along = np.array([np.cos(vehicle.heading_rad), np.sin(vehicle.heading_rad)])
    across = np.array([-along[1], along[0]])
    steps, heights = np.linspace(-0.42, 0.42, 9), vehicle.centre[2] + vehicle.height * np.array([-0.2, 0.0, 0.2])
    sides = [(sign * along, across, vehicle.length, vehicle.width) for sign in (1, -1)]
    sides += [(sign * across, along, vehicle.width, vehicle.length) for sign in (1, -1)]
    for outwards, sideways, deep, wide in sides:
        middle = vehicle.centre[:2] + 0.45 * deep * outwards
        if (T_map_cam[:2, 3] - middle) @ outwards <= 0:
            continue
        flat = middle + steps[:, None] * wide * sideways
        samples += [np.column_stack([flat, np.full(len(flat), z)]) for z in heights]
    return np.concatenate(samples) if samples else vehicle.corners


def _visible_share(
    points: NDArray[np.float64],
    camera: StereoCamera,
    T_map_cam: Pose,
    depth: NDArray[np.float32],
    mask: NDArray[np.bool_] | None = None,
) -> float:
    """Share of points that lie in the image with nothing before them (or, with a mask, on it)."""
    local = transform(inverse(T_map_cam), points)
    ahead = local[:, 2] > 0.5
    uv = np.full((len(points), 2), -1.0)
    uv[ahead] = camera.project(local[ahead])[:, :2]
    column, row = np.round(uv).astype(int).T
    inside = ahead & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    free = np.zeros(len(points), bool)
    if mask is not None:
        free[inside] = mask[row[inside], column[inside]]
    else:
        free[inside] = depth[row[inside], column[inside]] > local[inside, 2] - _OCCLUDED_M
    return float(free.mean())
