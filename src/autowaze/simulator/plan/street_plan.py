"""From a description to the plan of a street: roads, bays, asphalt, pavement, building lines and the ego's route."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from shapely import MultiPolygon, Point, Polygon, box, union_all
from shapely.affinity import rotate
from shapely.geometry.base import BaseGeometry

from autowaze.simulator.curve import Curve
from autowaze.simulator.description import BayKind, ParkingRow, Side, StreetDescription
from autowaze.simulator.plan.layouts import block, car_park, math_heading, through_street
from autowaze.simulator.plan.roads import LANE_M, Bay, Road, make_bay, pitch, strip_width
from autowaze.world.errors import AutowazeError
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap, ParkingSpot

Area = Polygon | MultiPolygon


def polygonal(geometry: BaseGeometry) -> Area:
    """The parts of a geometry that have an area."""
    parts = [part for part in getattr(geometry, "geoms", [geometry]) if isinstance(part, Polygon)]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


DRIVEWAY_M = 4.2
_CORNER_RADIUS_M = 5.0
_SIDES: tuple[Side, ...] = ("right", "left")
_UNDER_WALLS_M = 0.6
"""How far paving runs on under the buildings, so that no grass shows at their foot."""


@dataclass(frozen=True)
class Frontage:
    """A line with private ground to its left, where buildings, walls and hedges stand."""

    line: Curve
    kind: str


@dataclass(frozen=True)
class StreetPlan:
    """Everything flat, in map metres with the origin at the georeference.

    Attributes:
        crossings: zebra crossings as (road, distance along it).
        route: where the middle of the ego vehicle drives.
        loops: whether the route returns to its beginning.
    """

    roads: tuple[Road, ...]
    bays: tuple[Bay, ...]
    asphalt: Area
    pavement: Area
    frontages: tuple[Frontage, ...]
    crossings: tuple[tuple[int, float], ...]
    route: Curve
    loops: bool
    georeference: Georeference
    heading_rad: float

    @property
    def parking_map(self) -> ParkingMap:
        """The spots as the service gets them."""
        spots = tuple(ParkingSpot(bay.id, bay.polygon, bay.kind) for bay in self.bays)
        return ParkingMap(spots, self.georeference)

    def parking_geojson(self) -> dict[str, object]:
        """RFC 7946 feature collection of the spots, longitude and latitude."""
        features = []
        for bay in self.bays:
            ring = self.georeference.to_lon_lat(np.concatenate([bay.corners, bay.corners[:1]]))
            features.append(
                {
                    "type": "Feature",
                    "id": bay.id,
                    "geometry": {"type": "Polygon", "coordinates": [np.round(ring, 9).tolist()]},
                    "properties": {
                        "spot_id": bay.id,
                        "row": bay.row,
                        "kind": bay.kind,
                        "length_m": round(bay.length_m, 3),
                        "width_m": round(bay.width_m, 3),
                    },
                }
            )
        origin = self.georeference
        return {
            "type": "FeatureCollection",
            "georeference": {
                "lat": origin.lat_deg,
                "lon": origin.lon_deg,
                "altitude_m": origin.altitude_m,
                "heading_deg": 0.0,
            },
            "features": features,
        }


def plan_street(description: StreetDescription) -> StreetPlan:
    """Lay out a street.

    Raises:
        AutowazeError: rows of bays that do not fit.
    """
    rng = np.random.default_rng([description.seed, 1])
    layout = {"straight": through_street, "curved": through_street, "block": block, "lot": car_park}
    roads, route, main_roads = layout[description.layout](description)
    rows = description.rows or _rows_by_seed(description, roads, main_roads, rng)
    roads = _with_parking(roads, rows)
    bays, roads = _lay_bays(description, roads, rows)
    asphalt = _asphalt(roads, bays, description.layout == "lot")
    pavement = _pavement(roads, asphalt, description.layout == "lot")
    return StreetPlan(
        roads=tuple(roads),
        bays=tuple(bays),
        asphalt=asphalt,
        pavement=pavement,
        frontages=tuple(_frontages(description, roads, asphalt, rng)),
        crossings=tuple(_zebra_crossings(description, roads)),
        route=route,
        loops=description.layout == "block",
        georeference=Georeference(description.latitude, description.longitude, description.altitude_m),
        heading_rad=math_heading(description),
    )


def _rows_by_seed(
    description: StreetDescription, roads: list[Road], main_roads: list[int], rng: np.random.Generator
) -> tuple[ParkingRow, ...]:
    """Rows on both sides of every road where parking is allowed."""
    rows = []
    for road in main_roads:
        room = roads[road].allowed[1] - roads[road].allowed[0]
        for side in _SIDES:
            kinds: tuple[BayKind, ...] = ("parallel", "parallel", "perpendicular", "angled")
            kind = "perpendicular" if description.layout == "lot" else kinds[int(rng.integers(0, len(kinds)))]
            driveways = 0 if description.layout == "lot" else int(room // 30)
            count = int((room - driveways * DRIVEWAY_M) / pitch(kind))
            after = sorted({int(v) for v in rng.integers(2, max(3, count - 1), driveways)})
            rows.append(ParkingRow(road=road, side=side, kind=kind, count=count, driveways_after=tuple(after)))
    return tuple(rows)


def _with_parking(roads: list[Road], rows: tuple[ParkingRow, ...]) -> list[Road]:
    widths = {index: [0.0, 0.0] for index in range(len(roads))}
    for row in rows:
        if row.road not in widths:
            raise AutowazeError(f"rows: road {row.road} does not exist, this layout has roads 0 to {len(roads) - 1}")
        side = 0 if row.side == "left" else 1
        widths[row.road][side] = max(widths[row.road][side], strip_width(row.kind))
    return [replace(road, parking_m=(widths[i][0], widths[i][1])) for i, road in enumerate(roads)]


def _lay_bays(
    description: StreetDescription, roads: list[Road], rows: tuple[ParkingRow, ...]
) -> tuple[list[Bay], list[Road]]:
    bays: list[Bay] = []
    counters: dict[str, int] = {}
    for row in rows:
        road = roads[row.road]
        side = 1 if row.side == "left" else -1
        letter = row.side[0].upper()
        name = letter if len(roads) == 3 and row.road == 0 else f"{letter}{row.road + 1}"
        row_pitch = row.pitch_m or pitch(row.kind)
        if row_pitch < pitch(row.kind) - 0.4:
            raise AutowazeError(f"rows: pitch_m {row_pitch} is too small for {row.kind} bays")
        s = road.allowed[0] + row.start_m
        driveways = []
        for number in range(1, row.count + 1):
            counters[name] = counters.get(name, 0) + 1
            bays.append(make_bay(road, row.road, name, counters[name], row.kind, s + row_pitch / 2, side, row_pitch))
            s += row_pitch
            if number in row.driveways_after:
                driveways.append((s + DRIVEWAY_M / 2, side))
                s += DRIVEWAY_M
        if s > road.allowed[1] + 0.5:
            raise AutowazeError(
                f"rows: {row.count} {row.kind} bays on the {row.side} of road {row.road} need "
                f"{s - road.allowed[0]:.0f} m, there are {road.allowed[1] - road.allowed[0]:.0f} m; "
                "make length_m larger or count smaller"
            )
        roads[row.road] = replace(road, driveways=(*road.driveways, *driveways))
    return bays, roads


def _asphalt(roads: list[Road], bays: list[Bay], lot: bool) -> Area:
    if lot:
        centres = union_all([bay.polygon for bay in bays] + [road.carriageway for road in roads])
        # the car park is one rectangle of asphalt
        return polygonal(centres.minimum_rotated_rectangle.buffer(0.4, join_style="mitre"))
    lanes = union_all([road.carriageway for road in roads])
    lanes = lanes.buffer(_CORNER_RADIUS_M).buffer(-_CORNER_RADIUS_M)
    strips = []
    by_row: dict[tuple[int, int], list[Bay]] = {}
    for bay in bays:
        by_row.setdefault((bay.road, bay.side), []).append(bay)
    for (index, side), row in by_row.items():
        for bay in row:
            half = (bay.length_m if bay.kind == "parallel" else pitch(bay.kind)) / 2 + 0.03
            strips.append(
                roads[index].strip(LANE_M - 0.05, LANE_M + strip_width(bay.kind), bay.s - half, bay.s + half, side)
            )
            strips.append(bay.polygon)
    joined = union_all([lanes, *strips]).buffer(0.6).buffer(-0.6)
    return polygonal(joined.simplify(0.01))


def _pavement(roads: list[Road], asphalt: Area, lot: bool) -> Area:
    if lot:
        return polygonal(asphalt.buffer(2.0, join_style="mitre").difference(asphalt))
    bands = [
        road.strip(-LANE_M, road.building_line_m(side) + _UNDER_WALLS_M, 0.0, road.centre.length, side)
        for road in roads
        for side in (1, -1)
    ]
    return polygonal(union_all(bands).difference(asphalt).buffer(0))


def _frontages(
    description: StreetDescription, roads: list[Road], asphalt: Area, rng: np.random.Generator
) -> list[Frontage]:
    kinds = {"mixed": ["terraces", "shops", "houses", "terraces"]}.get(description.frontage, [description.frontage])
    if description.layout == "lot":
        ring = asphalt.buffer(5.0, join_style="mitre").exterior
        corners = np.array(ring.coords)
        if not ring.is_ccw:
            corners = corners[::-1]
        # buildings lie outside, to the left of the clockwise ring
        sides = list(zip(corners[::-1][:-1], corners[::-1][1:], strict=True))
        return [Frontage(Curve(np.stack(side)), str(rng.choice(kinds))) for side in sides]
    frontages = []
    for road in roads:
        for side in (1, -1):
            line = road.centre.offset(side * road.building_line_m(side))
            frontages.append(Frontage(line if side > 0 else line.reversed(), str(rng.choice(kinds))))
        for end in (road.centre.length, 0.0):
            # a building closes the view at the end of the road
            middle, ahead = road.centre.at(end), road.centre.tangent(end) * (1 if end > 0 else -1)
            across = np.array([ahead[1], -ahead[0]])
            reach = max(road.building_line_m(1), road.building_line_m(-1)) + 4.0
            line = Curve(np.stack([middle - reach * across, middle + reach * across]) + 0.5 * ahead)
            frontages.append(Frontage(line, "terraces"))
    return frontages


def _zebra_crossings(description: StreetDescription, roads: list[Road]) -> list[tuple[int, float]]:
    if description.layout == "lot":
        return []
    crossings = []
    for index, road in enumerate(roads):
        if road.allowed[1] > road.allowed[0]:
            crossings += [(index, road.allowed[0] - 4.2), (index, road.allowed[1] + 4.2)]
    return crossings


def site(plan: StreetPlan, margin_m: float = 60.0) -> Area:
    """A rectangle, turned with the street, around all of the plan."""
    turned = rotate(plan.asphalt, -plan.heading_rad, origin=Point(0, 0), use_radians=True)
    x0, y0, x1, y1 = turned.bounds
    around = box(x0 - margin_m, y0 - margin_m, x1 + margin_m, y1 + margin_m)
    return polygonal(rotate(around, plan.heading_rad, origin=Point(0, 0), use_radians=True))
