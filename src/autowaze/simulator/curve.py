"""Curves on the ground, parameterised by arc length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

_STEP_M = 0.5


@dataclass(frozen=True)
class Curve:
    """A polyline (N, 2) in map metres; `s` is the distance along it."""

    points: NDArray[np.float64]

    @property
    def s(self) -> NDArray[np.float64]:
        """Arc length at the points, (N,)."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])

    @property
    def length(self) -> float:
        """Metres from end to end."""
        return float(self.s[-1])

    def at(self, s: ArrayLike) -> NDArray[np.float64]:
        """Points (..., 2) at distances along the curve; beyond its ends it runs straight on."""
        s = np.asarray(s, np.float64)
        knots = self.s
        points = np.stack([np.interp(s, knots, self.points[:, i]) for i in range(2)], -1)
        before, after = np.minimum(s, 0.0), np.maximum(s - knots[-1], 0.0)
        first, last = self.tangent(0.0), self.tangent(knots[-1])
        return np.asarray(points + before[..., None] * first + after[..., None] * last)

    def tangent(self, s: ArrayLike) -> NDArray[np.float64]:
        """Unit direction (..., 2) at distances along the curve."""
        knots = self.s
        s = np.clip(np.asarray(s, np.float64), 0.0, knots[-1])
        half = min(_STEP_M, knots[-1] / 4)
        a, b = np.maximum(s - half, 0.0), np.minimum(s + half, knots[-1])
        ahead = np.stack(
            [np.interp(b, knots, self.points[:, i]) - np.interp(a, knots, self.points[:, i]) for i in (0, 1)], -1
        )
        return np.asarray(ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-12))

    def left(self, s: ArrayLike) -> NDArray[np.float64]:
        """Unit normal (..., 2) to the left of the direction of travel."""
        t = self.tangent(s)
        return np.stack([-t[..., 1], t[..., 0]], -1)

    def heading(self, s: ArrayLike) -> NDArray[np.float64]:
        """Direction of travel, radians counter-clockwise from east."""
        t = self.tangent(s)
        return np.asarray(np.arctan2(t[..., 1], t[..., 0]))

    def beside(self, s: ArrayLike, left_m: ArrayLike) -> NDArray[np.float64]:
        """Points at distances along the curve and to its left."""
        return np.asarray(self.at(s) + np.asarray(left_m, np.float64)[..., None] * self.left(s))

    def offset(self, left_m: float) -> Curve:
        """The parallel curve to the left."""
        s = np.linspace(0.0, self.length, max(2, int(self.length / _STEP_M)))
        return Curve(self.beside(s, np.full(len(s), left_m)))

    def reversed(self) -> Curve:
        """The same curve travelled the other way."""
        return Curve(self.points[::-1].copy())

    def part(self, start: float, end: float) -> Curve:
        """The stretch between two distances."""
        s = np.linspace(start, end, max(2, int(abs(end - start) / _STEP_M) + 1))
        return Curve(self.at(s))

    def curvature(self, s: ArrayLike) -> NDArray[np.float64]:
        """Change of heading per metre (1/m), positive to the left."""
        s = np.asarray(s, np.float64)
        turn = self.heading(s + 1.0) - self.heading(s - 1.0)
        return np.asarray((turn + np.pi) % (2 * np.pi) - np.pi) / 2.0


def bend(start: ArrayLike, heading_rad: float, length_m: float, turn_rad: float) -> Curve:
    """A curve of constant curvature from a point; `turn_rad` is the change of heading, positive to the left."""
    s = np.linspace(0.0, length_m, max(2, int(length_m / _STEP_M) + 1))
    heading = heading_rad + turn_rad * (s[:-1] + s[1:]) / (2 * length_m)
    steps = np.diff(s)[:, None] * np.stack([np.cos(heading), np.sin(heading)], -1)
    return Curve(np.concatenate([[np.asarray(start, np.float64)], np.asarray(start) + np.cumsum(steps, axis=0)]))


def rounded(corners: ArrayLike, radius_m: float) -> Curve:
    """Straight stretches through points (N, 2) with circular arcs at the corners."""
    corners = np.asarray(corners, np.float64)
    pieces = [corners[:1]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        to, away = corner - before, after - corner
        room = 0.499 * min(np.linalg.norm(to), np.linalg.norm(away))
        to, away = to / np.linalg.norm(to), away / np.linalg.norm(away)
        half_turn = 0.5 * float(np.arctan2(to[0] * away[1] - to[1] * away[0], to @ away))
        if abs(half_turn) < 1e-3:
            pieces.append(corner[None])
            continue
        reach = min(radius_m * abs(np.tan(half_turn)), room)
        # a quadratic Bezier leans into the turn as a driver does: the curvature starts and ends gently
        t = np.linspace(0.0, 1.0, 24)[:, None]
        start, end = corner - reach * to, corner + reach * away
        pieces.append((1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end)
    pieces.append(corners[-1:])
    return Curve(np.concatenate(pieces))
