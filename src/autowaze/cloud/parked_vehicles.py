"""The vehicles on the map, each merged from all boxes of it, and the spots that they stand in.

Boxes come and go with diffs. Only those are merged anew that hang together with one that came or went, so a diff
costs what it changes, however many cars have looked at the place before.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.box_overlap import lie_on_any
from autowaze.cloud.merging import SAME_VEHICLE_IOU, merge_parts
from autowaze.cloud.spot_grid import cells_in_reach
from autowaze.cloud.spots import SpotIndex
from autowaze.world.identity import session_of_key
from autowaze.world.vehicles import VehicleBoxes

GRAZING_OVERLAP = 0.25
"""Share of a vehicle that lies in a spot from which on it may be parked there."""
LEANING_RIM_M = 0.25
_CELL_M = 16.0
_REACH_M = 10.0
"""From the centre of a box to its farthest corner, and some more."""


class Testimony(NamedTuple):
    """What a session saw of a vehicle: map features, and the end of the last window that it was seen in."""

    session: int
    points: int
    seen_at: float


@dataclass
class ParkedVehicle:
    """One vehicle.

    Attributes:
        group: smallest key of the instances that its boxes came from.
        footprint: (4, 2) corners in map metres.
        area_m2: of the footprint.
        testimonies: by session.
        shares: share of the vehicle that lies in each spot that it meets, by row of the spot.
        home: the spot that it overlaps most, if enough of it lies there; -1 for none.
        edition: of the spots that `shares` and `home` are of.
    """

    group: int
    footprint: NDArray[np.float64]
    area_m2: float
    testimonies: list[Testimony]
    shares: dict[int, float] = field(default_factory=dict)
    home: int = -1
    edition: int = -1
    _covered: dict[int, NDArray[np.bool_]] = field(default_factory=dict)

    def covered(self, spot: int, index: SpotIndex) -> NDArray[np.bool_]:
        """Which cells (C,) of a spot's raster it covers, with a rim around it for drift."""
        if spot not in self._covered:
            self._covered[spot] = cells_in_reach(index.raster(spot).codes, self.footprint, LEANING_RIM_M)
        return self._covered[spot]

    def place(self, shares: dict[int, float], edition: int) -> None:
        """Note which spots it meets, by row ascending."""
        self.shares, self.edition, self._covered = shares, edition, {}
        best = max(shares, key=lambda spot: (shares[spot], -spot), default=-1)
        self.home = best if best >= 0 and shares[best] >= GRAZING_OVERLAP else -1


@dataclass(eq=False)
class _Cluster:
    """Boxes that hang together, and the vehicles that they make."""

    parts: VehicleBoxes
    corners: NDArray[np.float64]
    vehicles: list[ParkedVehicle]
    cells: set[tuple[int, int]]


class ParkedVehicles:
    """Vehicles by place.

    Args:
        spots: the spots.
    """

    def __init__(self, spots: SpotIndex) -> None:
        self._spots = spots
        self._by_group: dict[int, list[_Cluster]] = {}
        self._by_cell: dict[tuple[int, int], list[_Cluster]] = {}

    def replace(self, groups: NDArray[np.uint64], boxes: VehicleBoxes) -> None:
        """Forget the boxes of these groups (K,) and put these in their place."""
        gone = groups.tolist()
        torn = {id(cluster): cluster for group in gone for cluster in self._by_group.get(group, ())}
        if len(boxes):
            near = [c for c in self._near(boxes.centre, boxes.centre, _CELL_M) if id(c) not in torn]
            torn.update((id(c), c) for c in _met(near, boxes.corners))
        if not torn and len(boxes) == 0:
            return
        left = [self._taken_out(cluster) for cluster in torn.values()]
        parts = VehicleBoxes.concatenate([*left, boxes])
        if gone:
            stays = ~np.isin(parts.group, groups)
            stays[len(parts) - len(boxes) :] = True
            parts = parts[stays]
        self._put_in(parts)

    def around(self, spots: NDArray[np.int64]) -> dict[int, list[ParkedVehicle]]:
        """Vehicles that meet each of these spots (T,), by row of the spot, each list by group."""
        found: dict[int, list[ParkedVehicle]] = {spot: [] for spot in spots.tolist()}
        if not found:
            return found
        bounds = self._spots.bounds[spots]
        vehicles = [v for c in self._near(bounds[:, :2], bounds[:, 2:], _REACH_M) for v in c.vehicles]
        self._place([v for v in vehicles if v.edition != self._spots.edition])
        for vehicle in vehicles:
            for spot in vehicle.shares:
                if spot in found:
                    found[spot].append(vehicle)
        for here in found.values():
            here.sort(key=lambda vehicle: vehicle.group)
        return found

    def _place(self, vehicles: list[ParkedVehicle]) -> None:
        """Find the spots that each of them meets."""
        if not vehicles:
            return
        row, spot, common = self._spots.grid.overlaps(np.array([vehicle.footprint for vehicle in vehicles]))
        share = common / np.array([vehicle.area_m2 for vehicle in vehicles])[row]
        shares: list[dict[int, float]] = [{} for _ in vehicles]
        for number, here, part in zip(row.tolist(), spot.tolist(), share.tolist(), strict=True):
            shares[number][here] = part
        for vehicle, its_shares in zip(vehicles, shares, strict=True):
            vehicle.place(its_shares, self._spots.edition)

    def _near(self, low: NDArray[np.float64], high: NDArray[np.float64], margin_m: float) -> Iterable[_Cluster]:
        """Clusters in the cells that rectangles (M, 2), (M, 2) with a margin touch."""
        first = np.floor((low - margin_m) / _CELL_M).astype(np.int64)
        last = np.floor((high + margin_m) / _CELL_M).astype(np.int64)
        corners = set(map(tuple, np.hstack([first, last]).tolist()))
        cells = {(i, j) for i0, j0, i1, j1 in corners for i in range(i0, i1 + 1) for j in range(j0, j1 + 1)}
        return {id(c): c for cell in sorted(cells) for c in self._by_cell.get(cell, ())}.values()

    def _taken_out(self, cluster: _Cluster) -> VehicleBoxes:
        for group in set(cluster.parts.group.tolist()):
            _drop(self._by_group, group, cluster)
        for cell in cluster.cells:
            _drop(self._by_cell, cell, cluster)
        return cluster.parts

    def _put_in(self, boxes: VehicleBoxes) -> None:
        if len(boxes) == 0:
            return
        merged = merge_parts(boxes)
        parts, vehicles = merged.parts, merged.vehicles
        corners = parts.corners
        testimonies = _testimonies(parts, merged.whole, len(vehicles))
        footprints, area = list(vehicles.corners), (vehicles.length * vehicles.width).tolist()
        columns = (vehicles.group.tolist(), footprints, area, testimonies)
        every = [ParkedVehicle(*values) for values in zip(*columns, strict=True)]
        rows_of: dict[int, list[int]] = {}
        for row, number in enumerate(merged.cluster.tolist()):
            rows_of.setdefault(number, []).append(row)
        whole = merged.whole.tolist()
        cell_of_part, cell_of_vehicle = (_cells_of(centre) for centre in (parts.centre, vehicles.centre))
        for rows in rows_of.values():
            own = sorted({whole[row] for row in rows})
            cells = {*(cell_of_part[row] for row in rows), *(cell_of_vehicle[row] for row in own)}
            cluster = _Cluster(parts[np.array(rows)], corners[rows], [every[v] for v in own], cells)
            for group in set(cluster.parts.group.tolist()):
                self._by_group.setdefault(group, []).append(cluster)
            for cell in cells:
                self._by_cell.setdefault(cell, []).append(cluster)


def _cells_of(places: NDArray[np.float64]) -> list[tuple[int, int]]:
    """The cell of each place (N, 2)."""
    return [(x, y) for x, y in np.floor(places / _CELL_M).astype(np.int64).tolist()]


def _met(clusters: list[_Cluster], corners: NDArray[np.float64]) -> list[_Cluster]:
    """Those with a box that may be of one vehicle with one of these boxes (N, 4, 2)."""
    if not clusters:
        return []
    meets = lie_on_any(np.concatenate([cluster.corners for cluster in clusters]), corners, SAME_VEHICLE_IOU)
    starts = np.cumsum([0, *(len(cluster.corners) for cluster in clusters[:-1])])
    return [
        c for c, any_meets in zip(clusters, np.logical_or.reduceat(meets, starts).tolist(), strict=True) if any_meets
    ]


def _testimonies(parts: VehicleBoxes, whole: NDArray[np.int64], count: int) -> list[list[Testimony]]:
    """What each session saw of each vehicle, from its boxes (P,)."""
    found: list[dict[int, Testimony]] = [{} for _ in range(count)]
    columns = (whole.tolist(), parts.group.tolist(), parts.points.tolist(), parts.seen_at.tolist())
    for vehicle, group, points, seen_at in zip(*columns, strict=True):
        session = session_of_key(group)
        known = found[vehicle].get(session, Testimony(session, 0, 0.0))
        found[vehicle][session] = Testimony(session, known.points + points, max(known.seen_at, seen_at))
    return [list(of_vehicle.values()) for of_vehicle in found]


def _drop(clusters_by: dict, key: object, cluster: _Cluster) -> None:  # type: ignore[type-arg]
    clusters_by[key].remove(cluster)
    if not clusters_by[key]:
        del clusters_by[key]
