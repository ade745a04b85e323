"""Parking spots of an OpenStreetMap extract: mapped spaces, areas beside streets, and kerbs."""

from __future__ import annotations

from collections import Counter

import numpy as np
import shapely

from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingSpot
from autowaze.world.spot_check import MOST_OVERLAP, faults_of_shape, overlap_share
from autowaze.world.surveys.kerb_rules import CLOSED_ACCESS, kind_of, whole_number
from autowaze.world.surveys.kerb_spots import area_into_spots
from autowaze.world.surveys.osm_extract import OsmExtract, OsmWay
from autowaze.world.surveys.osm_kerbs import KerbSurvey
from autowaze.world.surveys.osm_streets import is_street

BESIDE_STREET = ("street_side", "lane", "on_kerb", "half_on_kerb", "shoulder", "layby")
NEAR_STREET_M = 15.0
_PARALLEL_RAD, _PERPENDICULAR_RAD = np.radians(20.0), np.radians(70.0)


def osm_spots(extract: OsmExtract, georeference: Georeference) -> tuple[list[ParkingSpot], Counter[str]]:
    """Spots in map metres, and what was left out, by reason.

    Where sources disagree the better one wins: a space that somebody drew, then an area, then a kerb.
    """
    streets = [
        shapely.LineString(georeference.to_map(way.lon_lat)[:, :2]) for way in extract.ways if is_street(way.tags)
    ]
    tree = shapely.STRtree(streets)
    left_out: Counter[str] = Counter()
    spaces: list[ParkingSpot] = []
    strips: list[ParkingSpot] = []
    for way in [way for way in extract.ways if way.is_closed] + list(extract.outlines):
        amenity = way.tags.get("amenity")
        if amenity not in ("parking", "parking_space"):
            continue
        if way.tags.get("access") in CLOSED_ACCESS:
            left_out[f"{amenity}: access={way.tags['access']}"] += 1
            continue
        area = shapely.Polygon(georeference.to_map(way.lon_lat)[:, :2])
        if not area.is_valid or area.area < 1.0:
            left_out[f"{amenity}: crosses itself or has no area"] += 1
            continue
        street = _street_near(area, streets, tree)
        if amenity == "parking_space":
            spaces += _space(way, area, street)
        elif way.tags.get("parking") in BESIDE_STREET:
            strips += _cut(way, area, street)
        else:
            left_out[f"parking={way.tags.get('parking', 'untold')}: its spaces are not drawn"] += 1
    left_out["parking_space as a node: no outline"] += sum(
        node.tags.get("amenity") == "parking_space" for node in extract.nodes
    )
    kerbs = KerbSurvey(extract, georeference)
    found = _without_overlaps([*spaces, *strips, *kerbs.spots()], left_out)
    return found, +(left_out + kerbs.left_out)


def _space(way: OsmWay, area: shapely.Polygon, street: shapely.LineString | None) -> list[ParkingSpot]:
    told = way.tags.get("parking_space:orientation", way.tags.get("orientation"))
    if (whole_number(way.tags.get("capacity")) or 1) > 1:
        return _cut(way, area, street)
    return [ParkingSpot(_name(way), area, kind_of(told) or _kind_by_street(area, street))]


def _cut(way: OsmWay, area: shapely.Polygon, street: shapely.LineString | None) -> list[ParkingSpot]:
    told = kind_of(way.tags.get("orientation", way.tags.get("parking:orientation")))
    cells, kind = area_into_spots(area, street, told, whole_number(way.tags.get("capacity")))
    return [ParkingSpot(f"{_name(way)}-{number}", cell, kind) for number, cell in enumerate(cells, start=1)]


def _name(way: OsmWay) -> str:
    return f"osm-w{way.id}" if way.id > 0 else f"osm-r{-way.id}"


def _street_near(
    area: shapely.Polygon, streets: list[shapely.LineString], tree: shapely.STRtree
) -> shapely.LineString | None:
    if not streets:
        return None
    rows = tree.query_nearest(area, max_distance=NEAR_STREET_M, all_matches=False)
    return streets[int(rows[0])] if len(rows) else None


def _kind_by_street(area: shapely.Polygon, street: shapely.LineString | None) -> str:
    """Whether a space lies along the street next to it, across it, or in between."""
    if street is None:
        return "unknown"
    corners = shapely.get_coordinates(area.minimum_rotated_rectangle)[:4]
    sides = [corners[1] - corners[0], corners[2] - corners[1]]
    long_side = max(sides, key=lambda side: float(np.linalg.norm(side)))
    s = street.project(area.centroid)
    a, b = (np.array(street.interpolate(min(max(x, 0.0), street.length)).coords[0]) for x in (s - 1.0, s + 1.0))
    cosine = abs(long_side @ (b - a)) / max(float(np.linalg.norm(long_side) * np.linalg.norm(b - a)), 1e-9)
    angle = float(np.arccos(np.clip(cosine, 0.0, 1.0)))
    return "parallel" if angle < _PARALLEL_RAD else "perpendicular" if angle > _PERPENDICULAR_RAD else "angled"


def _without_overlaps(spots: list[ParkingSpot], left_out: Counter[str]) -> list[ParkingSpot]:
    """Spots of a good shape that lie on no earlier one."""
    sound = []
    for spot in spots:
        faults = faults_of_shape(spot.polygon)
        left_out.update(f"spots: {fault}" for fault, _ in faults[:1])
        if not faults:
            sound.append(spot)
    polygons = np.array([spot.polygon for spot in sound], dtype=np.object_)
    one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    one, other = one[one < other], other[one < other]
    clash = overlap_share(polygons[one], polygons[other]) > MOST_OVERLAP
    gone = np.zeros(len(sound), np.bool_)
    for earlier, later in sorted(zip(one[clash].tolist(), other[clash].tolist(), strict=True)):
        if not gone[earlier]:
            gone[later] = True
    left_out["spots: another one lies there"] += int(gone.sum())
    return [spot for spot, is_gone in zip(sound, gone.tolist(), strict=True) if not is_gone]
