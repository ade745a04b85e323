"""How far matched points moved between two frames, and what the most of them agree on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.rematching import match_near_by
from autowaze.vehicle.semantics.whereabouts import LENGTH_M

ACCELERATION = 2.0
"""m/s^2, standard deviation of what traffic does."""
_GATE = 11.34  # chi-square, 3 degrees of freedom, 99 %
_GATE_2 = 9.21  # the same of 2
_MIN_BACKGROUND = 20
_MIN_JUMP_M = 0.15  # below it the displacement of the background is noise


@dataclass(frozen=True)
class Sighting:
    """Features of one frame with depth, N rows sorted by instance.

    Attributes:
        timestamp: seconds.
        instance, label, descriptor: (N,), (N,), (N, 32).
        disparity: (N,) float64, pixels.
        position: (N, 3) metres in the map, without the pose's jumps.
        covariance: (N, 3, 3) m^2, of each feature's own error.
        of_pose: (N, 3, 3), of what the features of an instance share because the pose is wrong.
        of_disparity: (N, 3, 3), of what they share because disparities of one surface are wrong together.
    """

    timestamp: float
    instance: NDArray[np.int32]
    label: NDArray[np.uint8]
    descriptor: NDArray[np.uint8]
    disparity: NDArray[np.float64]
    position: NDArray[np.float64]
    covariance: NDArray[np.float64]
    of_pose: NDArray[np.float64]
    of_disparity: NDArray[np.float64]


@dataclass(frozen=True)
class Velocity:
    """Mean (2,) in m/s with its covariance (2, 2), measured over a span of seconds."""

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    span: float

    def agrees_with(self, other: Velocity) -> bool:
        """Whether both may be of one motion, given what traffic may change in between."""
        changed = np.eye(2) * (ACCELERATION * abs(self.span - other.span)) ** 2
        difference = self.mean - other.mean
        covariance = self.covariance + other.covariance + changed
        return bool(difference @ np.linalg.solve(covariance, difference) < _GATE_2)


@dataclass(frozen=True)
class Place:
    """Where over ground an instance was seen at a time: (2,) metres in the map with covariance (2, 2)."""

    timestamp: float
    position: NDArray[np.float64]
    covariance: NDArray[np.float64]


def velocity_over(places: Sequence[Place]) -> Velocity:
    """The velocity that places, in order of time, tell; the first and the last say how exact it is."""
    times, positions = np.array([p.timestamp for p in places]), np.array([p.position for p in places])
    return median_velocity(times, positions, places[0].covariance + places[-1].covariance)


def median_velocity(
    times: NDArray[np.float64], positions: NDArray[np.float64], covariance: NDArray[np.float64]
) -> Velocity:
    """The median of the velocities between any two of some positions (Theil 1950, Sen 1968).

    When another thing half hides an instance some of its places are wrong altogether.

    Args:
        times: (N,) seconds, ascending.
        positions: (N, 2) metres in the map.
        covariance: (2, 2) m^2 of the way from the first to the last: what places share does not average out.
    """
    first, second = np.triu_indices(len(times), 1)
    slopes = (positions[second] - positions[first]) / (times[second] - times[first])[:, None]
    span = float(times[-1] - times[0])
    return Velocity(np.median(slopes, axis=0), covariance / span**2, span)


def places_of(sighting: Sighting) -> dict[int, Place]:
    """By instance the median of its features, any part of it: evenly likely all along a vehicle."""
    ids, first, counts = np.unique(sighting.instance, return_index=True, return_counts=True)
    places = {}
    for instance, start, n in zip(ids.tolist(), first.tolist(), counts.tolist(), strict=True):
        part = slice(start, start + n)
        covariance = sighting.covariance[part].mean(axis=0) / n
        covariance = covariance + sighting.of_pose[part].mean(axis=0) + sighting.of_disparity[part].mean(axis=0)
        slides = LENGTH_M[sighting.label[start]] ** 2 / 12.0 * np.eye(2)
        position = np.median(sighting.position[part, :2], axis=0)
        places[instance] = Place(sighting.timestamp, position, covariance[:2, :2] + slides)
    return places


def pose_jump(now: Sighting, before: Sighting) -> NDArray[np.float64]:
    """By how much (3,) the pose jumped since the frame before, as what stands seems to have moved; zero if not."""
    partner = match_near_by(now.descriptor, now.position, before.descriptor, before.position)
    rows = np.flatnonzero(partner >= 0)
    displacement = now.position[rows] - before.position[partner[rows]]
    agreed = agreed_displacement(displacement, now.covariance[rows] + before.covariance[partner[rows]], _MIN_BACKGROUND)
    if agreed is None or np.linalg.norm(agreed[0]) < _MIN_JUMP_M:
        return np.zeros(3)
    return agreed[0]


def agreed_displacement(
    displacement: NDArray[np.float64], covariance: NDArray[np.float64], min_matches: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """The displacement (3,) that most matches agree with, weighted by information, and its covariance (3, 3).

    Every match's displacement (N, 3) is tried, and none at all; with `covariance` (N, 3, 3) each says who agrees.
    """
    information = np.linalg.inv(covariance)
    tried = np.concatenate([np.zeros((1, 3)), displacement])
    difference = displacement[None, :, :] - tried[:, None, :]
    agrees = np.einsum("hni,nij,hnj->hn", difference, information, difference) < _GATE
    inliers = agrees[int(np.argmax(agrees.sum(axis=1)))]
    if inliers.sum() < max(min_matches, 0.4 * len(displacement)):
        return None
    spread = np.linalg.inv(information[inliers].sum(axis=0))
    mean = spread @ np.einsum("nij,nj->i", information[inliers], displacement[inliers])
    return mean, spread


def log_normal(x: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """Log density of a zero-mean normal distribution at x (2,), without the constant; asked for some hundred times a
    frame, so the 2 by 2 inverse is written out.
    """
    (a, b), (_, d) = covariance.tolist()
    u, v = x.tolist()
    determinant = a * d - b * b
    return -0.5 * float((d * u * u - 2.0 * b * u * v + a * v * v) / determinant + math.log(determinant))
