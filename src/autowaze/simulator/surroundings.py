"""What a map of a simulated street shows besides the spots: streets, pavements, buildings, trees.

Public, like the parking map: nothing here tells who parks where.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.simulator.plan.roads import LANE_M, Road
from autowaze.simulator.plan.street_plan import StreetPlan
from autowaze.simulator.street import Street
from autowaze.world.georeference import Georeference

SPEED_KMH = 30
AISLE_SPEED_KMH = 10
_NAMES = ("Elm", "Oak", "Maple", "Cedar", "Walnut", "Chestnut", "Birch", "Linden", "Hazel", "Willow", "Alder", "Rowan")
_SMOOTH_M = 0.05
_DIGITS = 8
"""A millimetre."""


def streets_geojson(street: Street) -> dict[str, Any]:
    """RFC 7946 feature collection, `properties.kind` is street, area, building or tree.

    Streets meet where they have a position in common.
    """
    plan, features = street.plan, []
    lot = street.description.layout == "lot"
    for number, line in enumerate(lane_lines(plan, lot)):
        name = "" if lot else f"{_NAMES[(street.description.seed + number) % len(_NAMES)]} Street"
        features.append(_street(line, name, AISLE_SPEED_KMH if lot else SPEED_KMH))
    for surface, ground in (("asphalt", plan.asphalt), ("pavement", plan.pavement)):
        features += [_feature(part, kind="area", surface=surface) for part in shapely.get_parts(ground)]
    for building in street.buildings:
        features.append(_feature(building.outline, kind="building", height_m=round(building.height_m, 2)))
    for thing in street.scene.things:
        if thing.model.startswith("tree-"):
            features.append(_feature(shapely.Point(thing.T_map_thing[:2, 3]), kind="tree"))
    return {"type": "FeatureCollection", "features": _to_lon_lat(features, plan.georeference)}


def lane_lines(plan: StreetPlan, lot: bool) -> list[shapely.LineString]:
    """Centre lines of the roads, or of a car park's aisles and what joins them; they meet in common positions."""
    return _joined(plan.roads) + (_between_aisles(plan.roads) if lot else [])


def _street(line: shapely.LineString, name: str, speed_kmh: int) -> dict[str, Any]:
    return _feature(line, kind="street", name=name, oneway=False, speed_kmh=speed_kmh, width_m=2 * LANE_M)


def _feature(shape: shapely.Geometry, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": shape, "properties": properties}


def _joined(roads: tuple[Road, ...]) -> list[shapely.LineString]:
    """Centrelines with a vertex wherever another one crosses, the same in both."""
    lines = [shapely.simplify(shapely.LineString(road.centre.points), _SMOOTH_M) for road in roads]
    points = [[shapely.get_coordinates(line)] for line in lines]
    for one, other in combinations(range(len(lines)), 2):
        crossings = shapely.get_coordinates(shapely.intersection(lines[one], lines[other]))
        points[one].append(crossings)
        points[other].append(crossings)
    return [_along(line, np.concatenate(own)) for line, own in zip(lines, points, strict=True)]


def _along(line: shapely.LineString, points: NDArray[np.float64]) -> shapely.LineString:
    """A line through points (N, 2) that lie on this one."""
    order = np.argsort(shapely.line_locate_point(line, shapely.points(points)), kind="stable")
    return shapely.remove_repeated_points(shapely.LineString(points[order]), 1e-6)


def _between_aisles(roads: tuple[Road, ...]) -> list[shapely.LineString]:
    """Where cars turn from one aisle of a car park into the next, at both ends."""
    there, back = roads
    ends = [(there.centre.points[0], back.centre.points[-1]), (there.centre.points[-1], back.centre.points[0])]
    return [shapely.LineString(np.stack(pair)) for pair in ends]


def _to_lon_lat(features: Iterable[dict[str, Any]], georeference: Georeference) -> list[dict[str, Any]]:
    out = []
    for feature in features:
        shape = shapely.transform(feature["geometry"], georeference.to_lon_lat)
        if isinstance(shape, shapely.Polygon):
            shape = shapely.orient_polygons(shape)
        shape = shapely.transform(shape, lambda lon_lat: np.round(lon_lat, _DIGITS))
        out.append({**feature, "geometry": shapely.geometry.mapping(shape)})
    return out
