"""Streets and buildings of OpenStreetMap, as the live map and routes want them."""

from __future__ import annotations

import re

import numpy as np
import shapely

from autowaze.world.georeference import Georeference
from autowaze.world.streets import DEFAULT_HEIGHT_M, Footprints, StreetNetwork, Streets, areas, buildings, streets
from autowaze.world.surveys.kerb_rules import metres, whole_number
from autowaze.world.surveys.osm_extract import OsmExtract, OsmWay, Tags

LANE_M = 3.0
FLOOR_M = 3.0
"""One level, https://wiki.openstreetmap.org/wiki/Key:building:levels."""
WIDTHS_M = {
    "motorway": 11.0, "trunk": 9.0, "primary": 8.0, "secondary": 7.0, "tertiary": 6.5, "unclassified": 5.5,
    "residential": 5.5, "living_street": 4.5, "service": 4.0, "pedestrian": 5.0,
}  # fmt: skip
"""Kerb to kerb where neither width nor lanes is told."""
SPEEDS_KMH = {
    "motorway": 120.0, "trunk": 90.0, "primary": 50.0, "secondary": 50.0, "tertiary": 50.0, "unclassified": 50.0,
    "residential": 30.0, "living_street": 7.0, "service": 10.0, "pedestrian": 7.0,
}  # fmt: skip
PATHS = ("footway", "path", "pedestrian", "steps", "cycleway", "track")
_WIDEST_M, _TALLEST_M, _FASTEST_KMH = 60.0, 900.0, 200.0
_LONGEST_NAME = 200


def is_street(tags: Tags) -> bool:
    """Whether cars drive there."""
    kind = tags.get("highway", "").removesuffix("_link")
    return kind in WIDTHS_M and kind not in PATHS and tags.get("area") != "yes"


def width_m(tags: Tags) -> float:
    """Width of a carriageway, metres: told, by lanes, or usual for its kind."""
    told = metres(tags.get("width:carriageway", tags.get("width")))
    if told is not None and 2.0 <= told <= _WIDEST_M:
        return told
    lanes = whole_number(tags.get("lanes"))
    if lanes is not None and lanes <= 12:
        return lanes * LANE_M
    usual = WIDTHS_M.get(tags.get("highway", "").removesuffix("_link"), 5.5)
    return max(usual * 0.6, LANE_M) if is_oneway(tags) else usual


def is_oneway(tags: Tags) -> bool:
    """Whether cars go one way only, along the way or against it."""
    return tags.get("oneway") in ("yes", "1", "true", "-1") or tags.get("junction") == "roundabout"


def street_network(extract: OsmExtract, georeference: Georeference) -> StreetNetwork:
    """Streets, paths, buildings and car parks."""
    outlines = [way for way in extract.ways if way.is_closed] + list(extract.outlines)
    houses = [way for way in outlines if "building" in way.tags and way.tags["building"] != "no"]
    parks = [way for way in outlines if way.tags.get("amenity") == "parking"]
    return StreetNetwork(
        georeference,
        _streets([way for way in extract.ways if _is_way_to_go(way.tags)], georeference),
        _footprints(houses, georeference),
        _areas(parks, georeference),
    )


def _is_way_to_go(tags: Tags) -> bool:
    return (is_street(tags) or tags.get("highway") in PATHS) and tags.get("area") != "yes"


def _streets(ways: list[OsmWay], georeference: Georeference) -> Streets:
    lines, kept = [], []
    for way in ways:
        points = georeference.to_map(way.lon_lat[::-1] if way.tags.get("oneway") == "-1" else way.lon_lat)[:, :2]
        line = shapely.LineString(points)
        if line.length > 0:
            lines.append(line)
            kept.append(way.tags)
    return streets(
        lines,
        [tags.get("name", "")[:_LONGEST_NAME] for tags in kept],
        [is_oneway(tags) for tags in kept],
        [_speed_kmh(tags) for tags in kept],
        [2.0 if tags.get("highway") in PATHS and "width" not in tags else width_m(tags) for tags in kept],
        [tags.get("foot") != "no" and not tags.get("highway", "").startswith("motorway") for tags in kept],
        [is_street(tags) and tags.get("motor_vehicle", tags.get("access")) not in ("no", "private") for tags in kept],
    )


def _speed_kmh(tags: Tags) -> float:
    found = re.fullmatch(r"(\d{1,3})\s*(mph|km/h)?", tags.get("maxspeed", "").strip())
    if found and 0 < int(found[1]) <= _FASTEST_KMH:
        return float(found[1]) * (1.609344 if found[2] == "mph" else 1.0)
    return SPEEDS_KMH.get(tags.get("highway", "").removesuffix("_link"), 5.0)


def _footprints(ways: list[OsmWay], georeference: Georeference) -> Footprints:
    shapes = [shapely.Polygon(georeference.to_map(way.lon_lat)[:, :2]) for way in ways]
    sound = [row for row, shape in enumerate(shapes) if shape.is_valid and shape.area > 1.0]
    return buildings([shapes[row] for row in sound], [_height_m(ways[row].tags) for row in sound])


def _height_m(tags: Tags) -> float:
    told = metres(tags.get("height"))
    if told is None:
        levels = metres(tags.get("building:levels"))  # half levels are allowed
        told = None if levels is None else levels * FLOOR_M
    return told if told is not None and 0 < told <= _TALLEST_M else DEFAULT_HEIGHT_M


def _areas(ways: list[OsmWay], georeference: Georeference) -> Footprints:
    shapes = [shapely.Polygon(georeference.to_map(way.lon_lat)[:, :2]) for way in ways]
    sound = [shape for shape in shapes if shape.is_valid and shape.area > 1.0]
    return areas(sound, np.full(len(sound), "parking").tolist())
