"""What the frames of a window say of each landmark, in compiled loops: a window has tens of thousands of sightings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.compiled import compiled

_VIEWS = 10  # bundle adjustment sees a landmark from so many keyframes at once
_LEAST_DISTANCE_M, _LEAST_INFORMATION = 1e-3, 1e-12


def by_landmark(
    row: NDArray[np.int64], is_asked: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Sightings by the landmark that they are of, in the order of time.

    Args:
        row: (S,) landmark of each sighting, -1 for one that is no more.
        is_asked: (L,) which landmarks are asked for.

    Returns:
        rows: (N,) the landmarks asked for that were seen, ascending.
        starts: (N + 1,) where the sightings of each begin in `order`, and their number.
        order: (M,) numbers of sightings.
    """
    rows, starts, order = _by_landmark(row, is_asked)
    return rows, starts, order


def summed_up(
    starts: NDArray[np.int64],
    order: NDArray[np.int64],
    frame: NDArray[np.int64],
    kind: NDArray[np.int64],
    depth: NDArray[np.float64],
    thin: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """What the sightings of each landmark come to.

    Args:
        starts, order: see `by_landmark`.
        frame, kind, depth: (S,) of each sighting.
        thin: (F,) which frames want more of the map.

    Returns:
        (N,) int64 each: the kind that most saw, the smallest of equals; how many there are; how many of them in frames
        that want more; the first of the nearest.
    """
    kinds, found, wanted, nearest = _summed_up(starts, order, frame, kind, depth, thin)
    return kinds, found, wanted, nearest


def position_sigmas(
    starts: NDArray[np.int64],
    order: NDArray[np.int64],
    frame: NDArray[np.int64],
    centre: NDArray[np.float64],
    position: NDArray[np.float64],
    depth_sigma_m: NDArray[np.float64],
    is_asked: NDArray[np.bool_],
    corner_px: float,
) -> NDArray[np.float64]:
    """Standard deviation (N,) of landmarks in the direction in which the place of each is known worst, metres.

    What the stereo pair does not tell of the depth, directions from several places do: their information,
    (f / sigma d)^2 (I - u u') each, is summed over the nearest views, and that of the nearest depth added.

    Args:
        starts, order: see `by_landmark`.
        frame: (S,) of each sighting; centre: (F, 3) of the camera in each frame, map metres.
        position: (N, 3) of the landmarks, map metres; depth_sigma_m: (N,) of the nearest depth measured.
        is_asked: (N,) of which landmarks it is asked; of others it is infinite.
        corner_px: f / sigma, focal length over the standard deviation of corners.
    """
    sigmas: NDArray[np.float64] = _position_sigmas(
        starts, order, frame, centre, position, depth_sigma_m, is_asked, corner_px
    )
    return sigmas


@compiled
def _by_landmark(row, is_asked):  # type: ignore[no-untyped-def]
    count = np.zeros(len(is_asked), np.int64)
    total = 0
    for sighting in range(len(row)):
        r = row[sighting]
        if r >= 0 and is_asked[r]:
            count[r] += 1
            total += 1
    rows = np.flatnonzero(count)
    starts, order = np.zeros(len(rows) + 1, np.int64), np.empty(total, np.int64)
    for n in range(len(rows)):
        starts[n + 1] = starts[n] + count[rows[n]]
        count[rows[n]] = starts[n]  # where its next sighting goes
    for sighting in range(len(row)):
        r = row[sighting]
        if r >= 0 and is_asked[r]:
            order[count[r]] = sighting
            count[r] += 1
    return rows, starts, order


@compiled
def _summed_up(starts, order, frame, kind, depth, thin):  # type: ignore[no-untyped-def]
    n = len(starts) - 1
    kinds, found = np.empty(n, np.int64), np.empty(n, np.int64)
    wanted, nearest = np.zeros(n, np.int64), np.empty(n, np.int64)
    for k in range(n):
        seen = order[starts[k] : starts[k + 1]]
        found[k], nearest[k] = len(seen), seen[0]
        for sighting in seen:
            wanted[k] += thin[frame[sighting]]
            if depth[sighting] < depth[nearest[k]]:
                nearest[k] = sighting
        kinds[k] = _majority(kind[seen])
    return kinds, found, wanted, nearest


@compiled
def _majority(values):  # type: ignore[no-untyped-def]
    """The most frequent value, the smallest of equals."""
    best, most = values[0], 0
    for i in range(len(values)):
        count = 0
        for value in values:
            count += value == values[i]
        if count > most or (count == most and values[i] < best):
            best, most = values[i], count
        if most == len(values):
            break
    return best


@compiled
def _position_sigmas(starts, order, frame, centre, position, depth_sigma_m, is_asked, corner_px):  # type: ignore[no-untyped-def]
    sigmas = np.full(len(position), np.inf)
    most = np.max(np.diff(starts)) if len(position) else 0
    rays, distances, information = np.empty((most, 3)), np.empty(most), np.empty((3, 3))
    for k in np.flatnonzero(is_asked):
        count = starts[k + 1] - starts[k]
        for i in range(count):
            seen_from = frame[order[starts[k] + i]]
            square = 0.0
            for a in range(3):
                rays[i, a] = position[k, a] - centre[seen_from, a]
                square += rays[i, a] * rays[i, a]
            distances[i] = max(np.sqrt(square), _LEAST_DISTANCE_M)
        _nearest_first(rays[:count], distances[:count], _VIEWS if count > _VIEWS else 1)
        information[:] = 0.0
        for view in range(min(count, _VIEWS)):
            across = (corner_px / distances[view]) ** 2
            along = depth_sigma_m[k] ** -2.0 if view == 0 else 0.0
            of_ray = (along - across) / distances[view] ** 2
            for a in range(3):
                information[a, a] += across
                for b in range(a, 3):
                    information[a, b] += of_ray * rays[view, a] * rays[view, b]
        sigmas[k] = max(_least_eigenvalue(information), _LEAST_INFORMATION) ** -0.5
    return sigmas


@compiled
def _nearest_first(rays, distances, n):  # type: ignore[no-untyped-def]
    """Bring the nearest n of rays (S, 3) with their distances (S,) to the front, in order."""
    for i in range(n):
        nearest = i + np.argmin(distances[i:])
        distances[i], distances[nearest] = distances[nearest], distances[i]
        for a in range(3):
            rays[i, a], rays[nearest, a] = rays[nearest, a], rays[i, a]


@compiled
def _least_eigenvalue(A):  # type: ignore[no-untyped-def]
    """Of a symmetric matrix (3, 3), whose upper triangle is read, in closed form (Smith 1961)."""
    mean = (A[0, 0] + A[1, 1] + A[2, 2]) / 3.0
    x, y, z, xy, xz, yz = A[0, 0] - mean, A[1, 1] - mean, A[2, 2] - mean, A[0, 1], A[0, 2], A[1, 2]
    spread = np.sqrt((x * x + y * y + z * z + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    if spread == 0.0:
        return mean
    half_det = (x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz)) / (2.0 * spread**3)
    angle = np.arccos(min(max(half_det, -1.0), 1.0)) / 3.0
    return mean + 2.0 * spread * np.cos(angle + 2.0 * np.pi / 3.0)
