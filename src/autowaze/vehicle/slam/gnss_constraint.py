"""Satellite fixes hold odometry by a long leash: they say little at once, but they do not drift."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.pose import Pose, make_pose, so3_exp

_INTERVAL_S = 1.0  # between fixes that count
# The error of a receiver between houses wanders slowly (first-order Gauss-Markov, 40 s): fixes a second apart share
# most of it. n of them over a time T tell as much as T / (2 * 40 s) independent ones (Bayley & Hammersley 1946).
_ERROR_LASTS_S = 40.0
_VERTICAL = 3.0  # heights are so much worse than places
_HUBER = 1.5  # sigmas beyond which a fix counts less and less
_GATE = 13.8  # of chi squared with 2 degrees of freedom, 99.9 %: beyond it is a reflection
_REMEMBERED, _MOST_REFUSED = 30, 0.75  # where so many of the latest fixes are refused, it is the pose that is wrong


@dataclass(frozen=True)
class GnssPosition:
    """A satellite fix in the map frame.

    Attributes:
        position: (3,) metres.
        sigma_m: standard deviation, east and north.
    """

    position: NDArray[np.float64]
    sigma_m: float


@dataclass(frozen=True)
class Correction:
    """What a fix changes.

    Attributes:
        motion: (4, 4), moves the pose and the map around it, map to map.
        remaining: (6, 6), takes errors of the pose before to what is left of them.
    """

    motion: Pose
    remaining: NDArray[np.float64]


class GnssConstraint:
    """Weighs fixes against what odometry has drifted: a Kalman filter of the pose's error, robust to reflections.

    Args:
        start_sigma: standard deviations of the pose at the start, metres and radians of heading: what a satellite
            receiver said of it. Zeros for a surveyed start.
    """

    def __init__(self, start_sigma: tuple[float, float] = (0.0, 0.0)) -> None:
        place, heading = np.square(start_sigma)
        self._start = np.diag([place, place, place * _VERTICAL**2, 0.0, 0.0, heading])
        self._at: NDArray[np.float64] | None = None
        self._next = -np.inf
        self._refused: deque[float] = deque(maxlen=_REMEMBERED)

    def correction(
        self, T_map_cam: Pose, drift: NDArray[np.float64], fix: GnssPosition, timestamp: float
    ) -> Correction | None:
        """How a fix corrects a pose whose odometry has drifted by this covariance (6, 6); None if it does not."""
        if timestamp < self._next or not np.isfinite(fix.position).all():
            return None
        self._next = timestamp + _INTERVAL_S
        self._carry_start(T_map_cam[:3, 3])
        P = drift + self._start
        off = fix.position - T_map_cam[:3, 3]
        distance = _sigmas(off[:2], P[:2, :2] + fix.sigma_m**2 * np.eye(2))
        if distance**2 > _GATE:
            self._refuse(off)
            return None
        self._refused.append(0.0)
        sigma = fix.sigma_m * np.array([1.0, 1.0, _VERTICAL])
        R = np.diag(sigma**2) * max(distance / _HUBER, 1.0) * 2 * _ERROR_LASTS_S / _INTERVAL_S
        gain = P[:, :3] @ np.linalg.inv(P[:3, :3] + R)
        remaining = np.eye(6)
        remaining[:, :3] -= gain
        self._start = remaining @ self._start @ remaining.T + gain @ R @ gain.T
        error = gain @ off
        turn, place = so3_exp(error[3:]), T_map_cam[:3, 3]
        return Correction(make_pose(turn, place + error[:3] - turn @ place), remaining)

    def _carry_start(self, position: NDArray[np.float64]) -> None:
        """A wrong heading of the start turns all motion since."""
        x, y, z = np.zeros(3) if self._at is None else position - self._at
        self._at = position.copy()
        turned = np.eye(6)
        turned[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        self._start = turned @ self._start @ turned.T

    def _refuse(self, off: NDArray[np.float64]) -> None:
        """Note a refused fix; where they agree that the pose is wrong, it may be so wrong."""
        self._refused.append(float(np.linalg.norm(off[:2])))
        refused = np.array(self._refused)
        if len(refused) == _REMEMBERED and np.mean(refused > 0) >= _MOST_REFUSED:
            wrong_m = float(np.median(refused[refused > 0]))
            self._start += np.diag([wrong_m**2, wrong_m**2, 0.0, 0.0, 0.0, 0.0])
            self._refused.clear()


def _sigmas(off: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """Mahalanobis distance."""
    return float(np.sqrt(off @ np.linalg.solve(covariance, off)))
