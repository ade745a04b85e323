"""What is wrong with drawn parking spots, and what of it can be mended without asking."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.drawn_spots import LONGEST_ID, DrawnSpots

SHORTEST_M, LONGEST_M = 3.0, 20.0
"""From a bay for tiny cars to one for coaches."""
NARROWEST_M, WIDEST_M = 1.5, 6.0
SLIVER_M = 1.0
"""What is narrower than this everywhere is a slip of the hand."""
LEAST_FILL = 0.6
"""Share of the smallest rectangle around it that a spot covers; bays are rectangles or slanted, not stars."""
MOST_OVERLAP = 0.1
"""Share of the smaller of two spots that may lie on the other: hands are not steady."""
FARTHEST_M = 100_000.0
"""The service takes nothing that is farther from the map's origin."""
FARTHEST_FROM_STREET_M = 30.0
"""An aisle of a car park that is not mapped may lie between a spot and its street."""


class Fault(StrEnum):
    """What can be wrong with a spot."""

    ID = "bad id"
    DUPLICATE_ID = "duplicate id"
    CROSSING = "crosses itself"
    WINDING = "clockwise"
    SLIVER = "sliver"
    SIZE = "wrong size"
    SHAPE = "odd shape"
    OVERLAP = "overlap"
    FAR = "too far away"
    OFF_STREET = "off any street"


@dataclass(frozen=True)
class Finding:
    """One fault of one spot.

    Attributes:
        row: of the spot.
        spot_id: its id.
        fault: what is wrong.
        detail: one line for a person.
        lon, lat: where, degrees.
    """

    row: int
    spot_id: str
    fault: Fault
    detail: str
    lon: float
    lat: float

    def __str__(self) -> str:
        return f"{self.spot_id}: {self.fault}: {self.detail} ({self.lat:.6f}, {self.lon:.6f})"


def check_spots(drawn: DrawnSpots, streets: NDArray[np.object_] | None = None) -> list[Finding]:
    """Everything that is wrong, by spot.

    Args:
        drawn: the spots.
        streets: (M,) centrelines in map metres, if known; without them no spot is off the streets.
    """
    outlines = drawn.outlines
    found = [*_of_names(drawn.ids), *_of_rings(drawn), *_of_shapes(outlines), *_of_places(outlines, streets)]
    found += [
        (row, Fault.OVERLAP, f"{share:.0%} of it lies on {drawn.ids[other]}")
        for row, other, share in overlaps(outlines)
    ]
    places = np.array([ring[0] for ring in drawn.rings]).reshape(-1, 2)
    order = sorted(found, key=lambda item: (item[0], list(Fault).index(item[1])))
    return [
        Finding(row, drawn.ids[row], fault, detail, float(places[row, 0]), float(places[row, 1]))
        for row, fault, detail in order
    ]


def mended(drawn: DrawnSpots) -> tuple[DrawnSpots, list[Finding]]:
    """The spots with the faults mended that have one cure only, and what those were.

    Rings are closed and wound counter-clockwise, corners that repeat are dropped, and an outline drawn twice under
    one id is kept once. What needs a decision stays: spots that overlap, cross themselves or have a strange size.
    """
    before = [finding for finding in check_spots(drawn) if finding.fault in (Fault.WINDING, Fault.DUPLICATE_ID)]
    rings = tuple(_tidy(ring) for ring in drawn.rings)
    first: dict[tuple[str, bytes], int] = {}
    for row, (spot_id, ring) in enumerate(zip(drawn.ids, rings, strict=True)):
        first.setdefault((spot_id, _canonical(ring).tobytes()), row)
    kept = sorted(first.values())
    after = replace(
        drawn,
        ids=tuple(drawn.ids[row] for row in kept),
        kinds=tuple(drawn.kinds[row] for row in kept),
        rings=tuple(rings[row] for row in kept),
    )
    left = {(finding.spot_id, finding.fault) for finding in check_spots(after)}
    return after, [finding for finding in before if (finding.spot_id, finding.fault) not in left]


_Found = tuple[int, Fault, str]


def faults_of_shape(outline: shapely.Polygon) -> list[tuple[Fault, str]]:
    """What is wrong with one outline in map metres, whatever else lies around it."""
    outlines = np.array([outline], dtype=np.object_)
    return [(fault, detail) for _, fault, detail in [*_of_shapes(outlines), *_of_places(outlines, None)]]


def overlaps(outlines: NDArray[np.object_]) -> Iterable[tuple[int, int, float]]:
    """Pairs (row, later row) that lie on each other by more than they may, with the share of the smaller one."""
    sound = np.flatnonzero(shapely.is_valid(outlines))
    one, other = shapely.STRtree(outlines[sound]).query(outlines[sound], predicate="intersects")
    one, other = sound[one[one < other]], sound[other[one < other]]
    share = overlap_share(outlines[one], outlines[other])
    bad = np.flatnonzero(share > MOST_OVERLAP)
    return list(zip(other[bad].tolist(), one[bad].tolist(), share[bad].tolist(), strict=True))


def overlap_share(one: NDArray[np.object_], other: NDArray[np.object_]) -> NDArray[np.float64]:
    """Share (N,) of the smaller outline of each pair that lies on the other."""
    smaller = np.minimum(shapely.area(one), shapely.area(other))
    return np.asarray(shapely.area(shapely.intersection(one, other)) / np.maximum(smaller, 1e-9))


def sides(outlines: NDArray[np.object_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Longer and shorter side (N,) of the smallest rectangle around each outline, metres."""
    corners = np.zeros((len(outlines), 4, 2))
    for row, rectangle in enumerate(shapely.minimum_rotated_rectangle(outlines)):
        points = shapely.get_coordinates(rectangle)[:4]
        corners[row, : len(points)] = points
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]
    lengths = np.stack([np.hypot(*first.T), np.hypot(*second.T)])
    return lengths.max(axis=0), lengths.min(axis=0)


def _of_names(ids: tuple[str, ...]) -> list[_Found]:
    found, seen = [], dict[str, int]()
    for row, spot_id in enumerate(ids):
        if not is_good_id(spot_id):
            found.append((row, Fault.ID, f"an id has 1 to {LONGEST_ID} printable characters and no slash"))
        if spot_id in seen:
            found.append((row, Fault.DUPLICATE_ID, f"feature {seen[spot_id]} has it too"))
        seen.setdefault(spot_id, row)
    return found


def is_good_id(spot_id: str) -> bool:
    """Whether a spot may be called so: its id is part of addresses and tables."""
    return (
        0 < len(spot_id) <= LONGEST_ID and spot_id.isprintable() and "/" not in spot_id and spot_id.strip() == spot_id
    )


def _of_rings(drawn: DrawnSpots) -> list[_Found]:
    clockwise = [row for row, ring in enumerate(drawn.rings) if _signed_area(ring) < 0]
    return [(row, Fault.WINDING, "RFC 7946 wants outer rings counter-clockwise") for row in clockwise]


def _of_shapes(outlines: NDArray[np.object_]) -> list[_Found]:
    found: list[_Found] = []
    sound = shapely.is_valid(outlines) & (shapely.area(outlines) > 0)
    for row in np.flatnonzero(~sound).tolist():
        found.append((row, Fault.CROSSING, f"{shapely.is_valid_reason(outlines[row])}"))
    rows = np.flatnonzero(sound)
    length, width = sides(outlines[rows])
    fill = shapely.area(outlines[rows]) / np.maximum(length * width, 1e-9)
    thin = shapely.is_empty(shapely.buffer(outlines[rows], -SLIVER_M / 2))
    for row, long_m, short_m, share, is_thin in zip(rows.tolist(), length, width, fill, thin, strict=True):
        if is_thin:
            found.append((row, Fault.SLIVER, f"nowhere wider than {SLIVER_M:g} m"))
        elif not (SHORTEST_M <= long_m <= LONGEST_M and NARROWEST_M <= short_m <= WIDEST_M):
            allowed = f"{SHORTEST_M:g} to {LONGEST_M:g} by {NARROWEST_M:g} to {WIDEST_M:g} m"
            found.append((row, Fault.SIZE, f"{long_m:.1f} by {short_m:.1f} m; spots measure {allowed}"))
        elif share < LEAST_FILL:
            found.append((row, Fault.SHAPE, f"covers {share:.0%} of the rectangle around it"))
    return found


def _of_places(outlines: NDArray[np.object_], streets: NDArray[np.object_] | None) -> list[_Found]:
    found: list[_Found] = []
    bounds = np.abs(shapely.bounds(outlines)).reshape(-1, 4).max(axis=1)
    for row in np.flatnonzero(~(bounds <= FARTHEST_M)).tolist():
        found.append((row, Fault.FAR, f"more than {FARTHEST_M / 1000:g} km from the origin of the map"))
    if streets is None or len(outlines) == 0:
        return found
    near = np.zeros(len(outlines), np.bool_)
    if len(streets):
        tree = shapely.STRtree(streets)
        near[tree.query(outlines, predicate="dwithin", distance=FARTHEST_FROM_STREET_M)[0]] = True
    for row in np.flatnonzero(~near & (bounds <= FARTHEST_M)).tolist():
        found.append((row, Fault.OFF_STREET, f"no street within {FARTHEST_FROM_STREET_M:g} m"))
    return found


def _tidy(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Closed, counter-clockwise, no corner twice in a row."""
    moved = np.ones(len(ring), np.bool_)
    moved[1:] = (ring[1:] != ring[:-1]).any(axis=1)
    ring = ring[moved]
    if (ring[0] != ring[-1]).any():
        ring = np.concatenate([ring, ring[:1]])
    return ring[::-1].copy() if _signed_area(ring) < 0 else ring


def _canonical(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same for the same outline wherever it begins."""
    corners = ring[:-1]
    return np.roll(corners, -int(np.lexsort(corners.T)[0]), axis=0)


def _signed_area(ring: NDArray[np.float64]) -> float:
    """Positive counter-clockwise; about the first corner, for degrees have few digits to spare."""
    x, y = (ring - ring[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
