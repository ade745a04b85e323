"""Random streets for training: one setting at a time, everything that comes and goes placed anew for every picture.

Nothing here is a drive. The camera stands anywhere on or off the lane and looks anywhere; cars fill bays, queue in the
lane, or stand where they have no business; what is rare in a drive (cones, two-wheelers, odd angles, dense rows right
before the camera) is common.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.simulator.description import StreetDescription
from autowaze.simulator.mesh import planted
from autowaze.simulator.plan.roads import LANE_M, Bay, Road
from autowaze.simulator.render.renderer import Renderer
from autowaze.simulator.scene import Thing
from autowaze.simulator.sensor import paint_lens_dirt
from autowaze.simulator.street import build_street
from autowaze.simulator.surfaces.sky import paint_sky, paint_surroundings
from autowaze.simulator.things.cars import paint_colour
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import heading_to_rotation, make_pose, so3_exp
from training.wardrobe import CLUTTER, TWO_WHEELERS, WALKERS, Wardrobe, add_models

_MAX_IDS = 250
_REACH_M = 60.0


@dataclass(frozen=True)
class Arrangement:
    """What stands where in one picture, and the camera.

    Attributes:
        things: instances with ids from 1, their contact shadows, and clutter without an id.
        labels: (N + 1,) uint8, `ClassLabel` of every id; background at 0.
    """

    things: list[Thing]
    labels: NDArray[np.uint8]
    T_map_cam: NDArray[np.float64]


class Setting:
    """One street with its renderer, ready to be filled again and again."""

    def __init__(self, description: StreetDescription, wardrobe: Wardrobe, rng: np.random.Generator) -> None:
        self._rng = rng
        self._street = build_street(description)
        self._cars = wardrobe.pick()
        self.camera = description.rig.camera
        scene = self._street.scene
        add_models(scene, self._cars, rng)
        light = replace(self._street.light, exposure=self._street.light.exposure * float(np.exp(rng.normal(0.0, 0.35))))
        sky = paint_sky(light, rng, 768)
        around = shapely.minimum_rotated_rectangle(self._street.plan.asphalt.buffer(11.0))
        self._renderer = Renderer(
            scene,
            self.camera,
            light,
            description.effects,
            shapely.get_coordinates(around)[:4],
            sky,
            paint_surroundings(light, sky, rng),
            paint_lens_dirt(rng),
            description.light.wet,
            threads=1,
        )

    def close(self) -> None:
        """Give the renderer's memory back."""
        self._renderer.close()

    def picture(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]:
        """A new picture (H, W, 3) uint8 BGR, its ids (H, W) uint8 and the labels of the ids."""
        arrangement = self._arrange()
        pose = arrangement.T_map_cam
        self._renderer.place_moving(arrangement.things, pose[:2, 3] + 15.0 * pose[:2, 2])
        before = None
        if self._rng.random() < 0.4:
            shift = np.append(self._rng.normal(0, [0.02, 0.01, 0.06]), self._rng.normal(0, 0.002, 3))
            before = pose @ make_pose(so3_exp(shift[3:]), shift[:3])
        rendering = self._renderer.render(pose, before)
        return rendering.picture, rendering.ids.astype(np.uint8), arrangement.labels

    def _arrange(self) -> Arrangement:
        rng = self._rng
        road = self._street.plan.roads[int(rng.integers(0, len(self._street.plan.roads)))]
        pose, eye = self._camera_pose(road)
        things: list[Thing] = []
        taken: list[NDArray[np.float64]] = [np.array([*eye, 1.2])]
        if rng.random() > 0.06:  # else a street without a car
            bays = [b for b in self._street.plan.bays if np.linalg.norm(b.centre - eye) < _REACH_M]
            occupancy, sloppiness = float(rng.choice([0.3, 0.7, 0.9, 1.0])), float(rng.choice([0.5, 1.0, 2.5]))
            self._fill_bays(things, taken, bays, occupancy, sloppiness)
            self._fill_lanes(things, taken, int(rng.poisson(2.0)))
            self._scatter_cars(things, taken, eye, pose, int(rng.poisson(1.5)))
        self._scatter_people(things, taken, eye, pose)
        self._scatter_clutter(things, taken, eye, pose)
        near = [t for t in things if np.linalg.norm(t.T_map_thing[:2, 3] - eye) < _REACH_M]
        labels, placed = [int(ClassLabel.BACKGROUND)], []
        for thing in near:
            if thing.label == ClassLabel.BACKGROUND:
                placed.append(thing)
            elif len(labels) < _MAX_IDS:
                placed.append(replace(thing, id=len(labels)))
                labels.append(int(thing.label))
                if thing.label in (ClassLabel.CAR, ClassLabel.TRUCK):
                    placed.append(_contact_shadow(thing))
        return Arrangement(placed, np.array(labels, np.uint8), pose)

    def _camera_pose(self, road: Road) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        rng = self._rng
        s = float(rng.uniform(1.0, road.centre.length - 1.0))
        side = int(rng.choice([1, -1]))
        if rng.random() < 0.75:
            out = -side * abs(rng.normal(LANE_M / 2, 0.6))
        else:
            out = float(rng.uniform(-1, 1)) * (LANE_M + 2.5)
        yaw = rng.normal(0, np.radians(7)) if rng.random() < 0.6 else rng.uniform(-1, 1) * np.radians(85)
        heading = float(road.centre.heading(s)) + (0.0 if side > 0 else np.pi) + yaw
        pitch, roll = rng.normal(np.radians(-0.5), np.radians(2.0)), rng.normal(0, np.radians(1.5))
        height = float(rng.choice([rng.uniform(1.4, 1.8), rng.uniform(1.0, 2.2)]))
        eye = road.centre.beside(s, out)
        level = heading_to_rotation(float(np.pi / 2 - heading))
        return make_pose(level @ so3_exp(np.array([pitch, 0.0, roll])), np.array([*eye, height])), eye

    def _car(self) -> Thing:
        rng = self._rng
        model, _ = self._cars[int(rng.integers(0, len(self._cars)))]
        kind, shape = model.shape.kind, model.shape
        tall = 1.22 if kind in ("minivan", "van", "truck") else 1.07
        scale = np.array([rng.uniform(0.92, 1.10), rng.uniform(0.95, 1.06), rng.uniform(0.93, tall)])
        if kind in ("van", "truck") and rng.random() < 0.15:  # about as large as a bus
            scale *= [rng.uniform(1.3, 1.9), 1.2, rng.uniform(1.2, 1.5)]
        T = np.diag([*scale, 1.0])
        size = (float(shape.length * scale[0]), float(shape.width * scale[1]), float(shape.overall_height * scale[2]))
        colour = paint_colour(rng, kind)
        if rng.random() < 0.3:
            grey = int(rng.choice([rng.integers(8, 60), rng.integers(60, 245)]))
            colour = (grey, grey, grey)
        return Thing(model.name, T, colour, 0, ClassLabel.CAR, size, kind)

    def _put(
        self, things: list[Thing], taken: list[NDArray[np.float64]], thing: Thing, x: float, y: float, heading: float
    ) -> None:
        """Add a thing unless it would stand in another or over the camera."""
        radius = 0.5 * thing.size[1]
        reach = max(0.5 * thing.size[0] - radius, 0.0)
        steps = np.linspace(-reach, reach, max(2, int(2 * reach / max(radius, 0.3)) + 1))
        discs = np.array([x, y]) + steps[:, None] * np.array([np.cos(heading), np.sin(heading)])
        others = np.array(taken)
        gaps = np.linalg.norm(discs[:, None] - others[None, :, :2], axis=2) - others[:, 2] - radius
        if gaps.min() < 0.02:
            return
        taken.extend(np.array([*disc, radius]) for disc in discs)
        z = 0.0 if self._street.plan.asphalt.contains(shapely.Point(x, y)) else 0.12
        T = planted(x, y, z, heading) @ thing.T_map_thing
        things.append(replace(thing, T_map_thing=T))

    def _fill_bays(
        self,
        things: list[Thing],
        taken: list[NDArray[np.float64]],
        bays: list[Bay],
        occupancy: float,
        sloppiness: float,
    ) -> None:
        rng = self._rng
        for bay in bays:
            if rng.random() < occupancy:
                x, y, heading = _in_bay(bay, sloppiness, rng)
                self._put(things, taken, self._car(), x, y, heading)

    def _fill_lanes(self, things: list[Thing], taken: list[NDArray[np.float64]], count: int) -> None:
        rng = self._rng
        for _ in range(count):
            road = self._street.plan.roads[int(rng.integers(0, len(self._street.plan.roads)))]
            s, side = float(rng.uniform(0, road.centre.length)), int(rng.choice([1, -1]))
            x, y = road.centre.beside(s, side * (LANE_M / 2 + rng.normal(0, 0.5)))
            heading = float(road.centre.heading(s)) + (np.pi if side > 0 else 0.0) + rng.normal(0, 0.05)
            self._put(things, taken, self._car(), float(x), float(y), heading)

    def _scatter_cars(
        self,
        things: list[Thing],
        taken: list[NDArray[np.float64]],
        eye: NDArray[np.float64],
        pose: NDArray[np.float64],
        count: int,
    ) -> None:
        """Cars anywhere in view, at any angle; some in a tight row of their own."""
        rng = self._rng
        for _ in range(count):
            x, y = self._in_view(eye, pose, 3.0, 30.0)
            heading, row = float(rng.uniform(-np.pi, np.pi)), int(rng.choice([1, 1, 1, 4]))
            beside = heading + (np.pi / 2 if rng.random() < 0.6 else 0.0)
            pitch = rng.uniform(2.3, 2.9) if beside != heading else rng.uniform(4.8, 5.8)
            for i in range(row):
                at = (x + i * pitch * np.cos(beside), y + i * pitch * np.sin(beside))
                self._put(things, taken, self._car(), *at, heading + rng.normal(0, 0.04))

    def _in_view(
        self, eye: NDArray[np.float64], pose: NDArray[np.float64], near: float, far: float
    ) -> tuple[float, float]:
        rng = self._rng
        forward = pose[:2, 2] / np.linalg.norm(pose[:2, 2])
        side = np.array([-forward[1], forward[0]])
        z = float(np.exp(rng.uniform(np.log(near), np.log(far))))
        at = eye + z * forward + rng.uniform(-1, 1) * (0.85 * z + 1.0) * side
        return float(at[0]), float(at[1])

    def _scatter_people(
        self,
        things: list[Thing],
        taken: list[NDArray[np.float64]],
        eye: NDArray[np.float64],
        pose: NDArray[np.float64],
    ) -> None:
        rng = self._rng
        casts = (
            (WALKERS, rng.poisson(2.0), ClassLabel.PERSON, (0.5, 0.5, 1.76)),
            (
                TWO_WHEELERS,
                rng.poisson(1.5),
                ClassLabel.TWO_WHEELER,
                (1.8, 0.5, 1.7),
            ),
            (("cone", "cone", "barrier"), rng.poisson(1.0) * rng.integers(0, 2), ClassLabel.CONE, (0.5, 0.5, 0.8)),
        )
        for names, count, label, size in casts:
            for _ in range(int(count)):
                x, y = self._in_view(eye, pose, 3.0, 25.0)
                name = str(rng.choice(names))
                tint = (255, 255, 255)
                if name in ("bicycle-t", "motorcycle-t"):
                    tint = tuple(int(v) for v in rng.integers(10, 240, 3))
                T = np.diag([*([rng.uniform(0.85, 1.1)] * 3), 1.0])
                shape = (2.0, 0.5, 1.0) if name == "barrier" else size
                thing = Thing(name, T, tint, 0, label, shape, name)
                self._put(things, taken, thing, x, y, float(rng.uniform(-np.pi, np.pi)))

    def _scatter_clutter(
        self,
        things: list[Thing],
        taken: list[NDArray[np.float64]],
        eye: NDArray[np.float64],
        pose: NDArray[np.float64],
    ) -> None:
        """What is no vehicle, where vehicles stand: walls, hedges, containers, bins, cabinets."""
        rng = self._rng
        names = [*CLUTTER, "bin_on_wheels", "litter_bin", "cabinet", "bench", "bollard"]
        for _ in range(int(rng.poisson(2.5))):
            x, y = self._in_view(eye, pose, 3.5, 30.0)
            name = str(rng.choice(names))
            tint = tuple(int(v) for v in rng.integers(20, 255, 3))
            stretch = np.diag([*rng.uniform(0.8, 1.25, 3), 1.0])
            size = (2.0, 1.2, 1.2) if name.startswith("clutter-") else (0.9, 0.5, 1.0)
            thing = Thing(name, stretch, tint, 0, ClassLabel.BACKGROUND, size)
            self._put(things, taken, thing, x, y, float(rng.uniform(-np.pi, np.pi)))


def _in_bay(bay: Bay, sloppiness: float, rng: np.random.Generator) -> tuple[float, float, float]:
    along, across = rng.normal(0, 0.25 * sloppiness), rng.normal(0, 0.12 * sloppiness)
    heading = bay.heading_rad + rng.normal(0, np.radians(1.8) * sloppiness)
    if rng.random() < (0.15 if bay.kind == "parallel" else 0.4):
        heading += np.pi
    direction = np.array([np.cos(bay.heading_rad), np.sin(bay.heading_rad)])
    at = bay.centre + along * direction + across * np.array([-direction[1], direction[0]])
    return float(at[0]), float(at[1]), float(heading)


def _contact_shadow(car: Thing) -> Thing:
    """The dark under a car whose model is stretched differently along its axes."""
    T = car.T_map_thing.copy()
    for axis in range(3):
        T[:3, axis] /= np.linalg.norm(T[:3, axis])
    T[:3, 0] *= car.size[0] / 2 + 0.16
    T[:3, 1] *= car.size[1] / 2 + 0.16
    T[2, 3] += 0.018
    return Thing("contact-shadow", T)
