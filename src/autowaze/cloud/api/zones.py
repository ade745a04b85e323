"""Spots as CDS has them: spaces along a kerb, and the zones that they lie in."""

from __future__ import annotations

import copy
import json
import uuid
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap

_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "https://github.com/autowaze/cds")
REACH_M = 1.0
"""Spots with gaps of less than twice this lie in one zone, which ends so far around them."""
FARTHEST_NEIGHBOUR_M = 12.0
"""Farther than the mitred rims of two spots can reach towards each other (GEOS cuts mitres at five times the rim)."""
_ANGLES = ("parallel", "perpendicular", "angled")


@dataclass(frozen=True)
class Zone:
    """A stretch of kerb.

    Attributes:
        rows: spots in it, rows of the parking map.
        polygon: outline in map metres.
        geometry: the same as GeoJSON.
        length_cm, width_cm: sides of the smallest rectangle around its spots.
    """

    id: str
    rows: tuple[int, ...]
    polygon: shapely.Polygon
    geometry: dict[str, Any]
    length_cm: int
    width_cm: int
    parking_angle: str | None


class Kerb:
    """Every zone and space of a parking map; the same spots give the same ids.

    Attributes:
        zones: by the first spot in them.
        zone_of: zone of each spot, by row.
        space_ids: CDS id of each spot, by row; `row_of_space` leads back.
        length_cm, width_cm: (S,) sides of the smallest rectangle around each spot.
        polygons: (S,) outlines in map metres.
    """

    def __init__(self, parking_map: ParkingMap) -> None:
        self.georeference = parking_map.georeference
        self.polygons = np.array([spot.polygon for spot in parking_map.spots], dtype=np.object_)
        self.bounds = shapely.bounds(self.polygons)
        self.numbers = [spot.id for spot in parking_map.spots]
        self.kinds = [spot.kind for spot in parking_map.spots]
        self.space_ids = [cds_id("space", self.georeference, spot.id) for spot in parking_map.spots]
        self.length_cm, self.width_cm = _sides_cm(self.polygons)
        self._adopt(self._surveyed(_neighbours(self.polygons)))

    def spliced(self, row: int, drawn: Kerb | None) -> Kerb:
        """A kerb with one spot in the place of that in a row, or after all others, or none there; this one stays.

        The zones are those that a new survey of all spots would find; only those around the place are surveyed.
        """
        affected = {zone.id: zone for near in self._near(row, drawn) if (zone := self.zone_of[near])}
        kerb = copy.copy(self)
        for column in ("numbers", "kinds", "space_ids"):
            items = getattr(self, column)
            setattr(kerb, column, items[:row] + (getattr(drawn, column) if drawn else []) + items[row + 1 :])
        for column in ("polygons", "bounds", "length_cm", "width_cm"):
            values = getattr(self, column)
            middle = [getattr(drawn, column)] if drawn else []
            setattr(kerb, column, np.concatenate([values[:row], *middle, values[row + 1 :]]))
        moves = drawn is None

        def moved(rows: Iterable[int]) -> tuple[int, ...]:
            return tuple(r - (r > row) for r in rows) if moves else tuple(rows)

        again = sorted(
            {r for zone in affected.values() for r in moved(r for r in zone.rows if r != row)}
            | ({row} if drawn else set())
        )
        zones = [
            replace(z, rows=moved(z.rows)) if moves and z.rows[-1] > row else z
            for z in self.zones
            if z.id not in affected
        ]
        parts = _neighbours(kerb.polygons[again]) if again else []
        zones += kerb._surveyed([tuple(again[r] for r in part) for part in parts])
        kerb._adopt(sorted(zones, key=lambda zone: zone.rows))
        return kerb

    def _near(self, row: int, drawn: Kerb | None) -> list[int]:
        """Spots whose zones may change with that in a row."""
        places = [*self.bounds[row : row + 1], *(drawn.bounds if drawn else [])]
        low, high = self.bounds[:, :2] - FARTHEST_NEIGHBOUR_M, self.bounds[:, 2:] + FARTHEST_NEIGHBOUR_M
        near = [np.flatnonzero((low <= place[2:]).all(axis=1) & (high >= place[:2]).all(axis=1)) for place in places]
        return [int(row) for row in np.unique(np.concatenate(near))]

    def _adopt(self, zones: list[Zone]) -> None:
        self.zones = tuple(zones)
        self.zone_of = {row: zone for zone in self.zones for row in zone.rows}
        self.zone_by_id = {zone.id: zone for zone in self.zones}
        self.row_of_space = {space_id: row for row, space_id in enumerate(self.space_ids)}

    def _surveyed(self, groups: list[tuple[int, ...]]) -> list[Zone]:
        """Zones of these groups of rows; what can be done for all of them at once is."""
        if not groups:
            return []
        rows, group = np.concatenate(groups), np.repeat(np.arange(len(groups)), [len(rows) for rows in groups])
        spots, starts = self.polygons[rows], np.searchsorted(group, np.arange(len(groups) + 1))
        # A little farther than neighbours are looked for, so that those who touch in one point become one piece.
        rims = shapely.buffer(spots, 1.01 * REACH_M, cap_style="square", join_style="mitre")
        around = np.array([shapely.union_all(rims[a:b]) for a, b in pairwise(starts)], dtype=np.object_)
        polygons = np.asarray(shapely.polygons(shapely.get_exterior_ring(around)), dtype=np.object_)
        lon_lat = shapely.transform(polygons, self.georeference.to_lon_lat)
        outlines = shapely.orient_polygons(shapely.transform(lon_lat, lambda points: np.round(points, 7)))
        length, width = _sides_cm(np.asarray(shapely.multipolygons(spots, indices=group), dtype=np.object_))
        columns = (groups, polygons.tolist(), shapely.to_geojson(outlines).tolist(), length.tolist(), width.tolist())
        return [
            Zone(
                cds_id("zone", self.georeference, self.numbers[own[0]]),
                own,
                polygon,
                json.loads(geometry),
                length_cm,
                width_cm,
                self._angle(own),
            )
            for own, polygon, geometry, length_cm, width_cm in zip(*columns, strict=True)
        ]

    def _angle(self, rows: tuple[int, ...]) -> str | None:
        of_spots = {self.kinds[row] for row in rows}
        return next(iter(of_spots)) if len(of_spots) == 1 and of_spots <= set(_ANGLES) else None


def cds_id(kind: str, georeference: Georeference, name: str) -> str:
    """A UUID that stays the same as long as what it names."""
    return str(uuid.uuid5(_NAMESPACE, f"{kind} {georeference.lat_deg!r} {georeference.lon_deg!r} {name}"))


def _neighbours(polygons: NDArray[np.object_]) -> list[tuple[int, ...]]:
    """Rows of spots that lie together, each row once, by the first row."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    mitred = shapely.buffer(polygons, REACH_M, cap_style="square", join_style="mitre")
    one, other = shapely.STRtree(mitred).query(mitred, predicate="intersects")
    pairs = coo_array((np.ones(len(one)), (one, other)), shape=(len(polygons), len(polygons)))
    label = connected_components(pairs, directed=False)[1]
    groups: dict[int, list[int]] = {}
    for row, group in enumerate(label.tolist()):
        groups.setdefault(group, []).append(row)
    return [tuple(rows) for rows in groups.values()]


def _sides_cm(shapes: NDArray[np.object_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Longer and shorter sides (N,) of the smallest rectangles around shapes (N,)."""
    corners, owner = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapes), return_index=True)
    corners = corners[np.searchsorted(owner, np.arange(len(shapes)))[:, None] + np.arange(3)]
    sides = np.linalg.norm(np.diff(corners, axis=1), axis=2)
    whole = np.round(100 * sides).astype(np.int64)
    return whole.max(axis=1), whole.min(axis=1)
