"""Things with a life of their own, and the paths they take."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.curve import Curve
from autowaze.simulator.mesh import planted
from autowaze.simulator.plan.roads import LANE_M, Bay, Road
from autowaze.simulator.scene import Thing

_PULL_OUT_M = {"parallel": 9.0, "perpendicular": 8.0, "angled": 7.0}
_ARC_POINTS = 60


@dataclass(frozen=True)
class Actor:
    """A thing with a pose per frame.

    Attributes:
        poses: (F, 4, 4) T_map_thing; a frame of NaN does not show it.
        gait: models that follow each other over `stride_m` of way, for legs.
    """

    thing: Thing
    poses: NDArray[np.float64]
    gait: tuple[str, ...] = ()
    stride_m: float = 1.0

    def in_frame(self, frame: int) -> Thing | None:
        """The thing where it is in a frame, or None."""
        T = self.poses[frame]
        if not np.isfinite(T[0, 0]):
            return None
        thing = self.thing.moved_to(T)
        if self.gait:
            step = self._way()[frame] / self.stride_m * len(self.gait)
            thing = replace(thing, model=self.gait[int(step) % len(self.gait)])
        return thing

    def _way(self) -> NDArray[np.float64]:
        at = np.nan_to_num(self.poses[:, :2, 3])
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))])

    def distance_to(self, places: NDArray[np.float64]) -> float:
        """Smallest distance in any frame to places (F, 2), NaN ones left out; infinite if never together."""
        away = np.linalg.norm(self.poses[:, :2, 3] - places, axis=1)
        return float(np.nanmin(away)) if np.isfinite(away).any() else np.inf


def follow(thing: Thing, path: Curve, s: NDArray[np.float64], z: float = 0.0, beyond_m: float = 0.0) -> Actor:
    """An actor at distances (F,) along a path; off its ends by more than `beyond_m` it is not there."""
    there = (s >= -beyond_m) & (s <= path.length + beyond_m)
    points, headings = path.at(s), path.heading(s)
    poses = np.stack([planted(x, y, z, h) for (x, y), h in zip(points, headings, strict=True)])
    poses[~there] = np.nan
    return Actor(thing, poses)


def lane_of(road: Road, side: int, from_centre_m: float = LANE_M / 2) -> Curve:
    """The line that traffic on one side of a road follows, in its direction (1 left, -1 right)."""
    line = road.centre.offset(side * from_centre_m)
    return line if side < 0 else line.reversed()


@dataclass(frozen=True)
class Manoeuvre:
    """The way from a bay into the lane: poses at the middle of the car, and whether it goes backwards."""

    points: NDArray[np.float64]
    headings: NDArray[np.float64]
    backwards: bool

    @property
    def way(self) -> NDArray[np.float64]:
        """Distance at the points, metres."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])


def pull_out(bay: Bay, lane: Curve, start: NDArray[np.float64], heading: float) -> tuple[Manoeuvre, float]:
    """From where a car stands in a bay to its lane, and the distance along the lane where it gets there.

    Parallel bays are left forwards; out of others a car backs, unless it was parked tail first.
    """
    nearest = _nearest(lane, start)
    traffic = float(lane.heading(nearest))
    facing = np.cos(heading - traffic)
    tail_first = (
        bay.kind != "parallel" and (np.array([np.cos(heading), np.sin(heading)]) @ (lane.at(nearest) - start)) > 0
    )
    backwards = bay.kind != "parallel" and not tail_first
    if bay.kind == "parallel" and facing < 0:
        heading = traffic
    joins = nearest + (-1.0 if backwards else 1.0) * _PULL_OUT_M[bay.kind]
    end = lane.at(joins)
    reach = 0.55 * float(np.linalg.norm(end - start))
    sign = -1.0 if backwards else 1.0
    out = sign * np.array([np.cos(heading), np.sin(heading)])
    into = sign * lane.tangent(joins)
    t = np.linspace(0, 1, _ARC_POINTS)[:, None]
    a, b, c, d = start, start + reach * out, end - reach * into, end
    points = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
    step = np.gradient(points, axis=0) * sign
    return Manoeuvre(points, np.unwrap(np.arctan2(step[:, 1], step[:, 0])), backwards), joins


def _nearest(curve: Curve, point: NDArray[np.float64]) -> float:
    return float(curve.s[np.argmin(np.linalg.norm(curve.points - point, axis=1))])


def leave(
    thing: Thing, manoeuvre: Manoeuvre, lane: Curve, joins: float, start_s: float, times: NDArray[np.float64]
) -> Actor:
    """Stand until a time, manoeuvre into the lane, drive off."""
    poses = [_leaving_pose(manoeuvre, lane, joins, float(t) - start_s) for t in times]
    return Actor(thing, np.stack(poses))


def arrive(
    thing: Thing, manoeuvre: Manoeuvre, lane: Curve, joins: float, end_s: float, times: NDArray[np.float64]
) -> Actor:
    """Come along the lane, manoeuvre into the bay so as to stand at a time."""
    way = float(manoeuvre.way[-1])
    poses = []
    for t in times:
        before = end_s - float(t)
        slow = min(max(before, 0.0) * _MANOEUVRE_MPS, way)
        if slow < way:
            poses.append(_on(manoeuvre, slow))
        else:
            poses.append(_on_lane(lane, joins - max(before - way / _MANOEUVRE_MPS - 1.0, 0.0) * _ARRIVING_MPS))
    return Actor(thing, np.stack(poses))


_MANOEUVRE_MPS, _ARRIVING_MPS = 1.9, 5.0


def _leaving_pose(manoeuvre: Manoeuvre, lane: Curve, joins: float, elapsed: float) -> NDArray[np.float64]:
    way = float(manoeuvre.way[-1])
    done = max(elapsed, 0.0) * _MANOEUVRE_MPS
    if done < way:
        return _on(manoeuvre, done)
    rest = elapsed - way / _MANOEUVRE_MPS
    return _on_lane(lane, joins + min(0.5 * 1.5 * rest**2 + _MANOEUVRE_MPS * rest, 8.0 * rest))


def _on(manoeuvre: Manoeuvre, way: float) -> NDArray[np.float64]:
    x, y = (float(np.interp(way, manoeuvre.way, manoeuvre.points[:, i])) for i in range(2))
    return planted(x, y, 0.0, float(np.interp(way, manoeuvre.way, manoeuvre.headings)))


def _on_lane(lane: Curve, s: float) -> NDArray[np.float64]:
    if not -5.0 <= s <= lane.length + 5.0:
        return np.full((4, 4), np.nan)
    x, y = lane.at(s)
    return planted(float(x), float(y), 0.0, float(lane.heading(s)))
