"""Spots as CDS has them: spaces along a kerb, and the zones that they lie in."""

from __future__ import annotations

import json
import uuid
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap

_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "https://github.com/autowaze/cds")
REACH_M = 1.0
"""Spots with gaps of less than twice this lie in one zone, which ends so far around them."""
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
        self.numbers = tuple(spot.id for spot in parking_map.spots)
        self.space_ids = tuple(cds_id("space", self.georeference, spot.id) for spot in parking_map.spots)
        self.row_of_space = {space_id: row for row, space_id in enumerate(self.space_ids)}
        sides = np.array([_sides_cm(polygon) for polygon in self.polygons])
        self.length_cm, self.width_cm = sides[:, 0], sides[:, 1]
        kinds = [spot.kind for spot in parking_map.spots]
        self.zones = tuple(self._zone(rows, kinds) for rows in _neighbours(self.polygons))
        self.zone_of = {row: zone for zone in self.zones for row in zone.rows}
        self.zone_by_id = {zone.id: zone for zone in self.zones}

    def _zone(self, rows: tuple[int, ...], kinds: list[str]) -> Zone:
        spots = self.polygons[list(rows)]
        # A little farther than neighbours are looked for, so that those who touch in one point become one piece.
        around = shapely.union_all(shapely.buffer(spots, 1.01 * REACH_M, cap_style="square", join_style="mitre"))
        polygon = shapely.Polygon(shapely.get_exterior_ring(around))
        lon_lat = shapely.transform(polygon, self.georeference.to_lon_lat)
        outline = shapely.orient_polygons(shapely.transform(lon_lat, lambda points: np.round(points, 7)))
        length, width = _sides_cm(shapely.union_all(spots))
        of_spots = {kinds[row] for row in rows}
        angle = next(iter(of_spots)) if len(of_spots) == 1 and of_spots <= set(_ANGLES) else None
        zone_id = cds_id("zone", self.georeference, self.numbers[rows[0]])
        return Zone(zone_id, rows, polygon, json.loads(shapely.to_geojson(outline)), length, width, angle)


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


def _sides_cm(shape: shapely.Geometry) -> tuple[int, int]:
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))
    sides = np.hypot(*np.diff(corners[:3], axis=0).T)
    return round(100 * float(sides.max())), round(100 * float(sides.min()))
