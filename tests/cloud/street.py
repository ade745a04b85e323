"""A street with a known answer, as a stereo camera that drives by would report it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from autowaze.world.feature_map import MapFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.ground import CELL_M, GroundCells
from autowaze.world.identity import feature_ids, instance_keys
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import InstanceSummaries, SemanticMapDiff, Trajectory
from autowaze.world.parking import ParkingMap, ParkingSpot
from autowaze.world.vehicles import box_corners

GEOREFERENCE = Georeference(40.0, -73.0)
SIGHT_M, FIELD_OF_VIEW_RAD = 20.0, np.radians(80.0)
FOCAL_TIMES_BASELINE, DISPARITY_SIGMA = 387.0, 0.4
SPEED_MPS, FRAME_S, WINDOW_S = 8.0, 0.1, 5.0
FEATURES_PER_FRAME = 40


@dataclass(frozen=True)
class Car:
    """A footprint: centre x, y, length, width (m) and compass heading (rad)."""

    x: float
    y: float
    heading: float
    length: float = 4.4
    width: float = 1.8

    @property
    def polygon(self) -> Polygon:
        return Polygon(_corners(self)[0])


@dataclass(frozen=True)
class Street:
    """Spots in a row to the right of a lane that starts at the origin and runs along a compass heading."""

    count: int = 15
    heading: float = 0.3
    bays: bool = False

    @property
    def pitch(self) -> float:
        return 2.5 if self.bays else 6.0

    @property
    def along(self) -> NDArray[np.float64]:
        return np.array([np.sin(self.heading), np.cos(self.heading)])

    @property
    def across(self) -> NDArray[np.float64]:
        return np.array([np.cos(self.heading), -np.sin(self.heading)])

    @property
    def length(self) -> float:
        return 12.0 + self.pitch * self.count

    def centre(self, spot: int) -> NDArray[np.float64]:
        aside = 5.5 if self.bays else 3.6
        return self.along * (10.0 + self.pitch * (spot + 0.5)) + self.across * aside

    @property
    def parking_map(self) -> ParkingMap:
        size = (self.pitch, 5.0) if self.bays else (self.pitch, 2.2)
        centres = np.array([self.centre(i) for i in range(self.count)])
        ones = np.ones(self.count)
        corners = box_corners(centres, ones * size[0], ones * size[1], ones * self.heading)
        return ParkingMap(tuple(ParkingSpot(f"S{i}", Polygon(ring)) for i, ring in enumerate(corners)), GEOREFERENCE)

    def park(self, spots: list[int], seed: int = 0) -> list[Car]:
        """Cars in these spots, none quite straight, none quite in the middle."""
        rng = np.random.default_rng(seed)
        cars = []
        for spot in spots:
            x, y = self.centre(spot) + rng.normal(0, 0.15, 2)
            heading = self.heading + (np.pi / 2 if self.bays else 0.0) + rng.normal(0, 0.03)
            cars.append(Car(x, y, heading, rng.uniform(3.9, 4.8), rng.uniform(1.7, 1.9)))
        return cars

    def drive(
        self,
        cars: list[Car],
        session: int = 1,
        start: float = 1000.0,
        drift: tuple[float, float] = (0.0, 0.0),
        seed: int = 0,
    ) -> list[SemanticMapDiff]:
        """The diffs of a car without a stored map that drives the lane; `drift` (along, across) moves what it says."""
        rng = np.random.default_rng(seed)
        offset = self.along * drift[0] + self.across * drift[1]
        frames = int(self.length / SPEED_MPS / FRAME_S)
        per_window = int(WINDOW_S / FRAME_S)
        diffs = []
        seen: set[int] = set()
        for sequence, first in enumerate(range(0, frames, per_window)):
            cameras = [self.along * SPEED_MPS * FRAME_S * f for f in range(first, min(first + per_window, frames))]
            diff = self._window(cars, np.array(cameras), session, sequence, start + first * FRAME_S, seen, rng)
            diffs.append(moved(diff, offset))
        return diffs

    def _window(self, cars, cameras, session, sequence, start, seen, rng) -> SemanticMapDiff:
        points, owner, views, frames = [], [], [], []
        for number, car in enumerate(cars, start=1):
            found, view, n = _see_car(car, [c for c in cars if c is not car], cameras, self.along, rng)
            if n >= 3:
                views.append((number, *view))
                frames.append(n)
                if number not in seen:
                    points.append(found)
                    owner.append(np.full(len(found), number))
        seen.update(v[0] for v in views)
        table = np.array(views).reshape(-1, 3)
        return SemanticMapDiff(
            session=session,
            sequence=sequence,
            start=start,
            end=start + WINDOW_S,
            georeference=GEOREFERENCE,
            frames=len(cameras),
            localized_frames=len(cameras),
            new=features(session, sequence, np.vstack(points) if points else np.zeros((0, 3)), owner, start),
            instances=InstanceSummaries(
                table[:, 0].astype(np.int32),
                np.full(len(table), ClassLabel.CAR, np.uint8),
                np.full(len(table), 0.8, np.float32),
                table[:, 1:].astype(np.float32),
                np.array(frames, dtype=np.uint16),
            ),
            ground=_see_ground(cars, cameras[::3], self.along),
            trajectory=self._path(cameras, start),
        )

    def _path(self, cameras, start) -> Trajectory:
        """Once a second, and the end."""
        rows = np.unique(np.append(np.arange(0, len(cameras), round(1.0 / FRAME_S)), len(cameras) - 1))
        position = np.column_stack([cameras[rows], np.zeros(len(rows))])
        return Trajectory(start + rows * FRAME_S, position, np.full(len(rows), self.heading, np.float32))


def features(session, sequence, position, owner, when) -> MapFeatures:
    """New features of vehicles at these positions (N, 3); `owner` lists arrays of instance ids."""
    n = len(position)
    ids = np.concatenate(owner).astype(np.uint64) if n else np.zeros(0, np.uint64)
    return MapFeatures(
        id=feature_ids(session, sequence, n),
        position=position,
        descriptor=np.zeros((n, 32), np.uint8),
        normal=np.zeros((n, 3), np.float32),
        min_distance=np.full(n, 1.0, np.float32),
        max_distance=np.full(n, 30.0, np.float32),
        label=np.full(n, ClassLabel.CAR, np.uint8),
        instance_key=instance_keys(session, ids),
        first_seen=np.full(n, when),
        last_seen=np.full(n, when),
        observations=np.full(n, 5, np.uint16),
    )


def moved(diff: SemanticMapDiff, offset: NDArray[np.float64]) -> SemanticMapDiff:
    """The same report by a car that believes itself elsewhere; the ground moves by whole cells."""
    cells = np.round(offset / CELL_M).astype(np.int32)
    ground = replace(diff.ground, ix=diff.ground.ix + cells[0], iy=diff.ground.iy + cells[1])
    return replace(diff, new=replace(diff.new, position=diff.new.position + np.append(offset, 0.0)), ground=ground)


def _corners(car: Car) -> NDArray[np.float64]:
    one = np.ones(1)
    return box_corners(np.array([[car.x, car.y]]), one * car.length, one * car.width, one * car.heading)


def _in_view(camera, along, points) -> NDArray[np.bool_]:
    offset = points - camera
    depth = offset @ along
    side = offset @ np.array([along[1], -along[0]])
    return (depth > 2.0) & (depth < SIGHT_M) & (np.abs(side) < depth * np.tan(FIELD_OF_VIEW_RAD / 2))


def _first_hit(camera, points, cars) -> NDArray[np.float64]:
    """Where along each ray from the camera to points (N, 2) the first car stands; 1 is the point itself."""
    first = np.full(len(points), np.inf)
    for car in cars:
        axes = np.array([[np.sin(car.heading), np.cos(car.heading)], [np.cos(car.heading), -np.sin(car.heading)]])
        origin = axes @ (camera - [car.x, car.y])
        ray = (points - camera) @ axes.T
        half = np.array([car.length, car.width]) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (-half - origin) / ray, (half - origin) / ray
        enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        first = np.where((enter < leave) & (leave > 0) & (enter > 0), np.minimum(first, enter), first)
    return first


def _see_car(car, others, cameras, along, rng):
    """Points (N, 3) on the sides that were seen, mean view direction, frames."""
    ring = _corners(car)[0]
    share = rng.random(4 * FEATURES_PER_FRAME)
    side = rng.integers(0, 4, len(share))
    surface = ring[side] + share[:, None] * (ring[(side + 1) % 4] - ring[side])
    surface = np.array([car.x, car.y]) + (surface - [car.x, car.y]) * rng.uniform(0.85, 1.0, (len(share), 1))
    edge = ring[(side + 1) % 4] - ring[side]
    outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    outward *= np.sign(np.sum(outward * (surface - [car.x, car.y]), axis=1, keepdims=True))
    total, count, view, n = np.zeros_like(surface), np.zeros(len(share)), np.zeros(2), 0
    for camera in cameras:
        ray = surface - camera
        visible = _in_view(camera, along, surface) & (np.sum(ray * outward, axis=1) < 0)
        visible &= _first_hit(camera, surface, others) > 1.0
        if visible.sum() < 5:
            continue
        depth = ray @ along
        noise = rng.normal(0, DISPARITY_SIGMA * depth**2 / FOCAL_TIMES_BASELINE)
        total += np.where(visible[:, None], surface + ray / depth[:, None] * noise[:, None], 0.0)
        count += visible
        centre_ray = np.array([car.x, car.y]) - camera
        view += centre_ray / np.linalg.norm(centre_ray)
        n += 1
    seen = count >= 3
    height = rng.uniform(0.2, 1.4, len(share))
    points = np.column_stack([total[seen] / count[seen, None], height[seen]])
    return points, view / max(n, 1), n


def _see_ground(cars, cameras, along) -> GroundCells:
    low = np.floor((cameras.min(axis=0) - SIGHT_M) / CELL_M).astype(int)
    high = np.ceil((cameras.max(axis=0) + SIGHT_M) / CELL_M).astype(int)
    ix, iy = (a.ravel() for a in np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]), indexing="ij"))
    centres = (np.stack([ix, iy], axis=1) + 0.5) * CELL_M
    free, obstacle = np.zeros(len(ix), int), np.zeros(len(ix), int)
    for camera in cameras:
        rows = np.flatnonzero(_in_view(camera, along, centres))
        distance = np.linalg.norm(centres[rows] - camera, axis=1)
        gap = (1.0 - _first_hit(camera, centres[rows], cars)) * distance
        free[rows] += gap < 0
        obstacle[rows] += (gap >= 0) & (gap < 0.5)
    seen = free + obstacle > 0
    return GroundCells(*(a[seen].astype(t) for a, t in ((ix, "i4"), (iy, "i4"), (free, "u2"), (obstacle, "u2"))))
