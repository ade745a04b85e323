"""How far what a drive maps lies off the parking map, told by the vehicles that stand in its rows.

Odometry over a street drifts, by a per cent of the way where a rig has a short baseline and is rectified to a tenth of
a pixel only, and what it maps drifts along. Where people park is surveyed, and they park in the middle of their spots
give or take some decimetres, each in his own way: thirty of them show a shift of a few centimetres. No truth is needed,
nor that a spot is known to be taken: vehicles are put to spots by probabilistic data association (Bar-Shalom, Daum &
Huang 2009), along the way, from where the drive began, so that a shift of more than half a bay is followed, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.camera import StereoCamera

SCALE_SIGMA, HEADING_SIGMA_RAD = 0.01, 0.003
"""Errors of odometry along and across, per metre of the way: a tenth of a pixel of disparity, where features lie 10 m
off and the baseline is 12 cm, is a hundredth."""
_RECTIFIED_PX, _SEEN_AT_M = 0.1, 10.0
CHANGES_AFTER_M = 40.0
"""How far such an error lasts, for it depends on what is in view."""
PARKED_SIGMA_M = (0.55, 0.3)
"""How far off the middle of a spot the box of a vehicle lies along and across it: how it is parked, and what of its
length is not seen."""
POINT_SIGMA_M = 1.5
"""And by how few points show it: over the square root of their number."""
MIN_POINTS = 20
"""Fewer are mostly of a part of a vehicle, or of none that is parked."""
NEAR_M = 4.0
"""Spots farther off than this are not a vehicle's."""
STRAYS_PER_M2 = 0.2
"""How dense boxes lie that are of no parked vehicle, or lie wholly wrong."""
_ROUNDS = 3


@dataclass(frozen=True)
class ParkedBoxes:
    """Boxes of vehicles as a drive mapped them, N rows.

    Attributes:
        centre: (N, 2) float64, map metres, as the points alone say.
        heading: (N,) float64, radians clockwise from north.
        points: (N,) int64, features that show it.
        seen: (N,) int64, point of the path that it was seen from nearest.
    """

    centre: NDArray[np.float64]
    heading: NDArray[np.float64]
    points: NDArray[np.int64]
    seen: NDArray[np.int64]


@dataclass(frozen=True)
class MapShift:
    """What is believed of the shift at a place of the path.

    Attributes:
        mean: (4,) float64, what has to be added to x and y, metres; per metre of the way along and to the left.
        spread: (4, 4) float64, covariance.
    """

    mean: NDArray[np.float64]
    spread: NDArray[np.float64]

    @classmethod
    def at_start(cls, sigma_m: float, scale_sigma: float = SCALE_SIGMA) -> MapShift:
        """None, where a drive's place is known so surely."""
        return cls(np.zeros(4), np.diag([sigma_m**2] * 2 + [scale_sigma**2, HEADING_SIGMA_RAD**2]))


def scale_sigma_of(camera: StereoCamera) -> float:
    """Error of the way's length by a rig's odometry, as a share: the wider the baseline, the less it leaves to mend."""
    return min(_RECTIFIED_PX * _SEEN_AT_M / camera.bf, SCALE_SIGMA)


def shifts_along(
    path: NDArray[np.float64],
    boxes: ParkedBoxes,
    spots: NDArray[np.float64],
    start: MapShift,
    scale_sigma: float = SCALE_SIGMA,
) -> tuple[NDArray[np.float64], MapShift]:
    """What has to be added to places that a drive mapped from each point of its path.

    The shift grows along the way by errors of scale and heading, d = e l + h l', which wander: a Kalman filter over the
    boxes in the order in which they were passed, smoothed backwards (Rauch, Tung & Striebel 1965).

    Args:
        path: (F, 2) map metres, F > 0; the first point is where `start` holds.
        boxes: what was mapped.
        spots: (S, 2) middles of the spots.
        start: what is believed of the shift there.
        scale_sigma: how wrong the length of the way may be, as a share.

    Returns:
        The shifts (F, 2), map metres, and what is believed at the end of the path.
    """
    moves = _moves(np.diff(path, axis=0, prepend=path[:1]))
    noise = _noise(boxes.heading, boxes.points)
    offset = spots[None] - boxes.centre[:, None]
    close = np.linalg.norm(offset, axis=2) < NEAR_M
    seen_at: list[list[tuple[NDArray[np.float64], NDArray[np.float64]]]] = [[] for _ in path]
    for row, at in enumerate(boxes.seen.tolist()):
        seen_at[at].append((offset[row][close[row]], noise[row]))
    shifts, end = _smoothed(moves, seen_at, start, None, scale_sigma)
    for _ in range(_ROUNDS - 1):
        shifts, end = _smoothed(moves, seen_at, start, shifts, scale_sigma)
    return shifts, end


def _noise(heading: NDArray[np.float64], points: NDArray[np.int64]) -> NDArray[np.float64]:
    """Covariances (N, 2, 2) of how far boxes lie off the middles of their spots."""
    axes = np.stack([np.sin(heading), np.cos(heading), np.cos(heading), -np.sin(heading)], axis=1).reshape(-1, 2, 2)
    variance = np.array(PARKED_SIGMA_M) ** 2 + (POINT_SIGMA_M**2 / points)[:, None]
    return np.asarray(np.einsum("nai,na,naj->nij", axes, variance, axes))


def _moves(step: NDArray[np.float64]) -> NDArray[np.float64]:
    """How the mean goes on (F, 4, 4) over each step (F, 2)."""
    keeps = np.exp(-np.linalg.norm(step, axis=1) / CHANGES_AFTER_M)
    moves = np.tile(np.eye(4), (len(step), 1, 1))
    moves[:, 2, 2] = moves[:, 3, 3] = keeps
    moves[:, :2, 2], moves[:, :2, 3] = step, np.column_stack([-step[:, 1], step[:, 0]])
    return moves


def _smoothed(
    moves: NDArray[np.float64],
    seen_at: list[list[tuple[NDArray[np.float64], NDArray[np.float64]]]],
    start: MapShift,
    about: NDArray[np.float64] | None,
    scale_sigma: float,
) -> tuple[NDArray[np.float64], MapShift]:
    """One pass forwards and one backwards over the path.

    Args:
        moves: (F, 4, 4). seen_at: at each point of the path, boxes: spots (K, 2) around one, and its noise (2, 2).
        about: (F, 2) shifts of the round before, about which vehicles are put to spots; else what the filter foretells.
    """
    count = len(moves)
    means, spreads = np.zeros((count, 4)), np.zeros((count, 4, 4))
    foretold, foretold_spreads = np.zeros((count, 4)), np.zeros((count, 4, 4))
    mean, spread = start.mean, start.spread
    for at in range(count):
        lost = 1.0 - moves[at, 2, 2] ** 2
        mean, spread = moves[at] @ mean, moves[at] @ spread @ moves[at].T
        spread[2, 2] += lost * scale_sigma**2
        spread[3, 3] += lost * HEADING_SIGMA_RAD**2
        foretold[at], foretold_spreads[at] = mean, spread
        for offsets, noise in seen_at[at]:
            mean, spread = _updated(mean, spread, offsets, noise, about[at] if about is not None else None)
        means[at], spreads[at] = mean, spread
    for at in range(count - 2, -1, -1):
        gain = spreads[at] @ moves[at + 1].T @ np.linalg.inv(foretold_spreads[at + 1])
        means[at] += gain @ (means[at + 1] - foretold[at + 1])
    return means[:, :2].copy(), MapShift(mean, spread)


def _updated(
    mean: NDArray[np.float64],
    spread: NDArray[np.float64],
    offsets: NDArray[np.float64],
    noise: NDArray[np.float64],
    about: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The belief after one box, which stands in one of some spots (K, 2), as they lie from it, or in none."""
    total = spread[:2, :2] + noise
    around, scale = (mean[:2], total) if about is None else (about, noise)
    residual = offsets - around
    weight = np.exp(-0.5 * np.einsum("ki,ij,kj->k", residual, np.linalg.inv(scale), residual))
    weight /= 2.0 * np.pi * np.sqrt(np.linalg.det(scale))
    weight /= weight.sum() + STRAYS_PER_M2
    innovations = offsets - mean[:2]
    innovation = weight @ innovations
    gain = spread[:, :2] @ np.linalg.inv(total)
    scatter = np.einsum("k,ki,kj->ij", weight, innovations, innovations) - np.outer(innovation, innovation)
    spread = spread - weight.sum() * gain @ total @ gain.T + gain @ scatter @ gain.T
    return mean + gain @ innovation, (spread + spread.T) / 2.0
