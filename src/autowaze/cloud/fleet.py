"""Where the cars are now, as far as their diffs tell; kept in memory only, under names that say nothing of a car."""

from __future__ import annotations

import hashlib
import hmac
import math
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.diff_kernels import is_orderly
from autowaze.world.map_diff import SemanticMapDiff, Trajectory

SILENT_S = 600.0
"""A car that has not been heard of for so long is gone."""
MOST_CARS = 1 << 17
MOST_PATH_POINTS = 64
"""Of one diff: a window is 5 s long, a trajectory has a point a second."""
PSEUDONYM_BYTES = 6
SLACK_S = 1.0
"""What a trajectory may stick out of its window."""


@dataclass(frozen=True)
class CarNow:
    """One car.

    Attributes:
        car: pseudonym.
        position: (3,) float64, metres in the map frame.
        heading_rad: clockwise from north.
        at: when it was there, seconds since the epoch (UTC).
        speed_mps: over the last part of its path; None where it has only been seen once.
    """

    car: str
    position: NDArray[np.float64]
    heading_rad: float
    at: float
    speed_mps: float | None
    heard_at: float


@dataclass(frozen=True)
class Report:
    """What a diff told of its car.

    Attributes:
        path: what is new of its way, oldest first; empty if the diff came late and a newer one has told already.
    """

    car: str
    path: Trajectory


class Fleet:
    """Follows cars by the trajectories of their diffs.

    A car's pseudonym is a keyed hash of its diff session. The key is drawn anew by every process and never leaves it,
    and cars draw new sessions themselves: a pseudonym can be tied neither to a token nor to another day's.

    Args:
        now: seconds since the epoch (UTC); None if drives of another day are replayed.
        clock: monotonic seconds.
    """

    def __init__(self, now: Callable[[], float] | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._clock = clock
        self._key = secrets.token_bytes(32)
        self._cars: OrderedDict[int, CarNow] = OrderedDict()

    def note(self, diff: SemanticMapDiff) -> Report:
        """Follow the car of an accepted diff."""
        known, path = self._cars.get(diff.session), _path_of(diff)
        car = self.pseudonym(diff.session) if known is None else known.car
        if known is not None and len(path) and path.time[0] <= known.at:
            path = path[path.time > known.at]
        if len(path):
            position, at = path.position[-1], float(path.time[-1])
            speed = _speed(path, known)
            known = CarNow(car, position, float(path.heading[-1]), at, speed, self._clock())
        elif known is not None:
            known = replace(known, heard_at=self._clock())
        if known is not None:
            self._cars[diff.session] = known
            self._cars.move_to_end(diff.session)
        self._forget()
        return Report(car, path)

    def cars(self) -> list[CarNow]:
        """Every car heard of lately, the one heard of last at the end; none whose diffs tell of long ago."""
        self._forget()
        if self._now is None:
            return list(self._cars.values())
        since = self._now() - SILENT_S
        return [car for car in self._cars.values() if car.at >= since]

    def pseudonym(self, session: int) -> str:
        """What a session is called."""
        return hmac.new(self._key, session.to_bytes(8, "big"), hashlib.sha256).hexdigest()[: 2 * PSEUDONYM_BYTES]

    def _forget(self) -> None:
        while self._cars:
            session, oldest = next(iter(self._cars.items()))
            if len(self._cars) <= MOST_CARS and oldest.heard_at > self._clock() - SILENT_S:
                return
            del self._cars[session]


def _path_of(diff: SemanticMapDiff) -> Trajectory:
    """What of its path lies in its window, in the order of time, each moment once, no more points than are shown."""
    path, since, until = diff.trajectory, diff.start - SLACK_S, diff.end + SLACK_S
    if len(path) <= MOST_PATH_POINTS and is_orderly(path.time, path.position, path.heading, since, until):
        return path
    return _thinned(path[(path.time >= since) & (path.time <= until)])  # nor times that are no numbers


def _thinned(path: Trajectory) -> Trajectory:
    """In the order of time, each moment once, and no more points than are shown."""
    path = path[np.isfinite(path.position).all(axis=1) & np.isfinite(path.heading)]
    path = path[np.unique(path.time, return_index=True)[1]]
    if len(path) > MOST_PATH_POINTS:
        path = path[np.linspace(0, len(path) - 1, MOST_PATH_POINTS).round().astype(np.int64)]
    return path


def _speed(path: Trajectory, known: CarNow | None) -> float | None:
    """Metres a second between the last two places."""
    if len(path) > 1:
        before, then = path.position[-2], float(path.time[-2])
    elif known is not None:
        before, then = known.position, known.at
    else:
        return None
    east, north = (path.position[-1] - before).tolist()[:2]
    return math.hypot(east, north) / (float(path.time[-1]) - then)
