"""Everyone else on the street: cars both ways, people, cyclists, drivers who come, go, or stand in the lane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.actors import Actor, arrive, follow, lane_of, leave, pull_out
from autowaze.simulator.curve import Curve
from autowaze.simulator.ego import EgoMotion
from autowaze.simulator.mesh import Mesh, planted
from autowaze.simulator.parking import draw_car
from autowaze.simulator.plan.roads import LANE_M, Road
from autowaze.simulator.scene import Model, Thing
from autowaze.simulator.street import FIRST_MOVING_ID, FIRST_OTHER_ID, Street
from autowaze.simulator.things.ground import KERB_M
from autowaze.simulator.things.people import OUTFITS, PERSON_SIZE, STRIDE_M, WALK_PHASES, rider, walker
from autowaze.simulator.things.two_wheelers import (
    BICYCLE_SIZE,
    CYCLIST_SIZE,
    MOTORCYCLE_SIZE,
    SADDLE_M,
    bicycle,
    motorcycle,
)
from autowaze.world.labels import ClassLabel

_TRIES = 25
_CLEAR_M = 5.5
"""Two moving vehicles' middles keep at least this distance, lanes apart being less."""
_PASSING_M = 2.4
_SWERVE_M, _SWERVE_LENGTH_M = 2.1, 13.0
_DRIVING_KINDS = ("city", "hatch", "sedan", "estate", "suv", "minivan", "van", "pickup")


@dataclass(frozen=True)
class Traffic:
    """The ego's route round obstacles, what stands, and who moves once the ego's timing is known."""

    route: Curve
    still: tuple[Thing, ...]
    _street: Street
    _seed: int

    def timed(self, ego: EgoMotion) -> tuple[list[Actor], tuple[Thing, ...]]:
        """Actors and still things, the actors with a pose for each of the ego's frames."""
        return _Stage(self._street, ego, self.still, np.random.default_rng(self._seed)).actors(), self.still


def stage_traffic(street: Street, rng: np.random.Generator) -> Traffic:
    """Decide where the ego drives and what stands about."""
    _add_models(street)
    double_parked, route = _double_park(street, rng)
    still = (*double_parked, *_parked_two_wheelers(street, rng), *_road_works(street, rng))
    return Traffic(route, still, street, int(rng.integers(0, 2**62)))


def _add_models(street: Street) -> None:
    models = street.scene.models
    for outfit in range(OUTFITS):
        for phase in range(WALK_PHASES):
            models[f"walker-{outfit}-{phase}"] = Model(((walker(outfit, phase / WALK_PHASES), "plain"),))
        models[f"cyclist-{outfit}"] = Model(((Mesh.concatenate([bicycle(), rider(outfit, SADDLE_M)]), "plain"),))
    models["bicycle"] = Model(((bicycle(), "plain"),))
    models["motorcycle"] = Model(((motorcycle(), "metal"),))


def _double_park(street: Street, rng: np.random.Generator) -> tuple[list[Thing], Curve]:
    """Cars that stand in the ego's lane beside the parked ones; the route swings round them."""
    route = street.plan.route
    wanted = street.description.traffic.double_parked
    cars: list[Thing] = []
    if wanted == 0 or street.description.layout == "lot":
        return cars, route
    road = street.plan.roads[0]
    places = np.sort(rng.uniform(road.allowed[0] + 14.0, road.allowed[1] - 12.0, wanted))
    s_grid = np.arange(0.0, route.length, 0.5)
    points = route.at(s_grid)
    left_m = np.zeros(len(s_grid))
    last = -np.inf
    for place in places:
        if place - last < 30.0:
            continue
        last = float(place)
        car = draw_car(street.scene, _DRIVING_KINDS, street.description.seed, rng, FIRST_OTHER_ID + len(cars))
        at = road.centre.beside(place, -(LANE_M - car.size[1] / 2 + 0.25))
        cars.append(
            car.moved_to(
                planted(float(at[0]), float(at[1]), 0.0, float(road.centre.heading(place)) + float(rng.normal(0, 0.02)))
            )
        )
        middle = float(s_grid[np.argmin(np.linalg.norm(points - at, axis=1))])
        beyond = np.clip((np.abs(s_grid - middle) - 4.5) / _SWERVE_LENGTH_M, 0.0, 1.0)
        left_m = np.maximum(left_m, _SWERVE_M * 0.5 * (1 + np.cos(np.pi * beyond)))
    return cars, Curve(route.beside(s_grid, left_m))


def _parked_two_wheelers(street: Street, rng: np.random.Generator) -> list[Thing]:
    things: list[Thing] = []
    for _ in range(int(rng.poisson(5 * street.description.clutter))):
        road = street.plan.roads[int(rng.integers(0, len(street.plan.roads)))]
        if road.pavement_m <= 0:
            continue
        side, s = int(rng.choice([1, -1])), float(rng.uniform(2.0, road.centre.length - 2.0))
        at = road.centre.beside(s, side * (road.building_line_m(side) - 0.95))
        kind = "bicycle" if rng.random() < 0.75 else "motorcycle"
        colour = tuple(int(v) for v in rng.integers(20, 220, 3))
        heading = float(road.centre.heading(s)) + float(rng.normal(0, 0.15)) + float(rng.choice([0, np.pi]))
        size = BICYCLE_SIZE if kind == "bicycle" else MOTORCYCLE_SIZE
        id = FIRST_OTHER_ID + 100 + len(things)
        things.append(
            Thing(
                kind,
                planted(float(at[0]), float(at[1]), KERB_M, heading),
                (colour[0], colour[1], colour[2]),
                id,
                ClassLabel.TWO_WHEELER,
                size,
                kind,
            )
        )
    return things


def _road_works(street: Street, rng: np.random.Generator) -> list[Thing]:
    """Cones round a barrier at the edge of a pavement."""
    road = street.plan.roads[0]
    if rng.random() > 0.6 * street.description.clutter or road.pavement_m <= 0:
        return []
    side, s0 = int(rng.choice([1, -1])), float(rng.uniform(road.allowed[0], road.allowed[1]))
    heading = float(road.centre.heading(s0))
    things = []
    for i, (ds, out) in enumerate([(0.0, 1.3), (-1.6, 0.8), (1.6, 0.8), (-1.6, 1.9), (1.6, 1.9)]):
        at = road.centre.beside(s0 + ds, side * (road.kerb_m(side) + out))
        name, size = ("barrier", (2.0, 0.4, 1.05)) if i == 0 else ("cone", (0.42, 0.42, 0.74))
        things.append(
            Thing(
                name,
                planted(float(at[0]), float(at[1]), KERB_M, heading),
                id=FIRST_OTHER_ID + 200 + i,
                label=ClassLabel.CONE,
                size=size,
                kind=name,
            )
        )
    return things


class _Stage:
    """Brings the actors on, one kind after another, and keeps them from running into each other."""

    def __init__(self, street: Street, ego: EgoMotion, still: tuple[Thing, ...], rng: np.random.Generator) -> None:
        self._street, self._ego, self._rng = street, ego, rng
        self._times = ego.frame_times
        self._ego_places = ego.position(self._times)
        self._obstacles = np.array(
            [thing.T_map_thing[:2, 3] for thing in still if thing.label == ClassLabel.CAR]
        ).reshape(-1, 2)
        self._cast: list[Actor] = []
        self._next_id = FIRST_MOVING_ID

    def actors(self) -> list[Actor]:
        traffic = self._street.description.traffic
        for count, enter in (
            (traffic.ahead, self._car_ahead),
            (traffic.leaving, self._leaving),
            (traffic.arriving, self._arriving),
            (traffic.oncoming, self._oncoming),
            (traffic.crossing, self._crossing),
            (traffic.cyclists, self._cyclist),
            (traffic.crossing_pedestrians, self._crossing_pedestrian),
            (traffic.pedestrians, self._pedestrian),
        ):
            for _ in range(count):
                self._bring_on(enter)
        return self._cast

    def _bring_on(self, enter: Callable[[], Actor | None]) -> None:
        for _ in range(_TRIES):
            actor = enter()
            if actor is not None and np.isfinite(actor.poses[:, 0, 0]).any() and self._has_room(actor):
                self._cast.append(actor)
                self._next_id += 1
                return

    def _has_room(self, actor: Actor) -> bool:
        on_foot = actor.thing.label == ClassLabel.PERSON
        keep = 1.2 if on_foot else _PASSING_M
        if actor.distance_to(self._ego_places) < keep:
            return False
        if self._obstacles.size and not on_foot:
            away = np.linalg.norm(actor.poses[:, None, :2, 3] - self._obstacles, axis=2)
            if np.isfinite(away).any() and np.nanmin(away) < _PASSING_M:
                return False
        return all(
            actor.distance_to(other.poses[:, :2, 3]) > (0.8 if on_foot else _CLEAR_M * 0.55) for other in self._cast
        )

    def _car(self) -> Thing:
        return draw_car(self._street.scene, _DRIVING_KINDS, self._street.description.seed, self._rng, self._next_id)

    def _meeting(self) -> tuple[float, Road, float]:
        """A random moment, the road that the ego is on then, and the distance along it."""
        time = float(self._rng.uniform(0.1, 1.0) * self._times[-1])
        place = self._ego.position(time)
        candidates = [
            r
            for r in self._street.plan.roads
            if abs(float(r.centre.tangent(r.centre.length / 2) @ self._direction(time))) > 0.6
        ]
        road = min(candidates or self._street.plan.roads, key=lambda r: _away(r.centre, place))
        return time, road, _project(road.centre, place)

    def _direction(self, time: float) -> NDArray[np.float64]:
        step = self._ego.position(time + 0.2) - self._ego.position(time - 0.2)
        return np.asarray(step / max(float(np.linalg.norm(step)), 1e-6))

    def _oncoming(self) -> Actor:
        time, road, s = self._meeting()
        same_way = float(road.centre.tangent(s) @ self._direction(time)) > 0
        lane = lane_of(road, 1 if same_way else -1)
        meets = _project(lane, road.centre.at(s))
        speed = float(self._rng.uniform(5.5, 8.5))
        return follow(self._car(), lane, meets + speed * (self._times - time))

    def _car_ahead(self) -> Actor:
        gap = float(self._rng.uniform(11.0, 24.0)) + 14.0 * sum(1 for a in self._cast if a.thing.kind)
        s = np.interp(self._times, self._ego.time, self._ego.s)
        drift = gap + 2.0 * np.sin(0.35 * self._times + float(self._rng.uniform(0, 6.28))) + 0.25 * self._times
        return follow(self._car(), self._ego.path, s + drift, beyond_m=45.0)

    def _crossing(self) -> Actor | None:
        time, road, _ = self._meeting()
        others = [r for r in self._street.plan.roads if r is not road and r.centre.length > 0]
        if not others or self._street.description.layout == "lot":
            return None
        other = others[int(self._rng.integers(0, len(others)))]
        lane = lane_of(other, int(self._rng.choice([1, -1])))
        return follow(self._car(), lane, lane.length / 2 + float(self._rng.uniform(5.0, 8.0)) * (self._times - time))

    def _leaving(self) -> Actor | None:
        cars = [c for c in self._street.parked if c.thing.id not in {a.thing.id for a in self._cast}]
        if not cars:
            return None
        car = cars[int(self._rng.integers(0, len(cars)))]
        road = self._street.plan.roads[car.bay.road]
        lane = lane_of(road, car.bay.side)
        T = car.thing.T_map_thing
        manoeuvre, joins = pull_out(car.bay, lane, T[:2, 3], float(np.arctan2(T[1, 0], T[0, 0])))
        passes = self._ego_passes(car.bay.centre)
        start = passes + float(
            self._rng.uniform(-5.0, -1.0) if self._rng.random() < 0.7 else self._rng.uniform(1.5, 4.0)
        )
        return leave(car.thing, manoeuvre, lane, joins, max(start, 0.5), self._times)

    def _arriving(self) -> Actor | None:
        taken = {c.bay.id for c in self._street.parked}
        free = [
            b
            for b in self._street.plan.bays
            if b.id not in taken and b.id not in self._street.description.parking.vacant
        ]
        if not free:
            return None
        bay = free[int(self._rng.integers(0, len(free)))]
        road = self._street.plan.roads[bay.road]
        lane = lane_of(road, bay.side)
        manoeuvre, joins = pull_out(bay, lane, bay.centre, bay.heading_rad)
        end = self._ego_passes(bay.centre) + float(self._rng.uniform(-4.0, 3.0))
        return arrive(self._car(), manoeuvre, lane, joins, end, self._times)

    def _ego_passes(self, place: NDArray[np.float64]) -> float:
        """Seconds at which the ego vehicle is nearest to a place."""
        return float(self._times[np.argmin(np.linalg.norm(self._ego_places - place, axis=1))])

    def _cyclist(self) -> Actor:
        time, road, s = self._meeting()
        same_way = float(road.centre.tangent(s) @ self._direction(time)) > 0
        lane = lane_of(road, 1 if same_way else -1, LANE_M - 0.55)
        meets = _project(lane, road.centre.at(s))
        outfit = int(self._rng.integers(0, OUTFITS))
        thing = Thing(
            f"cyclist-{outfit}",
            np.eye(4),
            (255, 255, 255),
            self._next_id,
            ClassLabel.TWO_WHEELER,
            CYCLIST_SIZE,
            "cyclist",
        )
        return follow(thing, lane, meets + float(self._rng.uniform(3.0, 5.0)) * (self._times - time))

    def _person(self, path: Curve, s: NDArray[np.float64], z: float) -> Actor:
        outfit = int(self._rng.integers(0, OUTFITS))
        scale = float(self._rng.uniform(0.90, 1.07))
        size = (PERSON_SIZE[0] * scale, PERSON_SIZE[1] * scale, PERSON_SIZE[2] * scale)
        thing = Thing(
            f"walker-{outfit}-0",
            planted(0, 0, 0, 0, scale),
            (255, 255, 255),
            self._next_id,
            ClassLabel.PERSON,
            size,
            "pedestrian",
        )
        actor = follow(thing, path, s, z)
        return Actor(
            actor.thing, actor.poses, tuple(f"walker-{outfit}-{p}" for p in range(WALK_PHASES)), STRIDE_M * scale
        )

    def _pedestrian(self) -> Actor:
        time, road, s = self._meeting()
        side, way = int(self._rng.choice([1, -1])), int(self._rng.choice([1, -1]))
        lot = road.pavement_m <= 0
        out = LANE_M - 0.4 if lot else road.kerb_m(side) + float(self._rng.uniform(1.2, road.pavement_m - 0.8))
        path = road.centre.offset(side * out)
        path = path if way > 0 else path.reversed()
        start = _project(path, road.centre.at(s)) + float(self._rng.uniform(4.0, 18.0)) * (
            1 if path.tangent(1.0) @ self._direction(time) > 0 else -1
        )
        return self._person(
            path, start + float(self._rng.uniform(1.0, 1.6)) * (self._times - time), 0.0 if lot else KERB_M
        )

    def _crossing_pedestrian(self) -> Actor:
        time, road, s = self._meeting()
        side = int(self._rng.choice([1, -1]))
        reach = LANE_M + max(road.parking_m) + 0.8 if road.pavement_m > 0 else LANE_M
        path = Curve(np.stack([road.centre.beside(s, side * reach), road.centre.beside(s, -side * reach)]))
        speed = float(self._rng.uniform(1.2, 1.7))
        start = time - path.length / speed - float(self._rng.uniform(1.5, 4.0))
        return self._person(path, speed * (self._times - start), 0.0)


def _project(curve: Curve, place: NDArray[np.float64]) -> float:
    """Distance along a curve of its point nearest to a place."""
    fine = np.linspace(0.0, curve.length, max(2, int(curve.length / 0.5)))
    return float(fine[np.argmin(np.linalg.norm(curve.at(fine) - place, axis=1))])


def _away(curve: Curve, place: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(curve.at(_project(curve, place)) - place))
