"""Parking maps from the Curb Data Specification 1.0 and 1.1: spaces, and zones whose spaces are not drawn."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import shapely

from autowaze.world.drawn_spots import DrawnSpots, outer_ring
from autowaze.world.errors import MapFileError
from autowaze.world.georeference import Georeference
from autowaze.world.spot_check import is_good_id
from autowaze.world.surveys.kerb_spots import area_into_spots
from autowaze.world.surveys.polygon_collection import middle_of

_ANGLES = ("parallel", "perpendicular", "angled")
MOST_SPACES = 10_000


def is_cds(document: Any) -> bool:
    """Whether a parsed document is an answer of `/curbs/zones` or `/curbs/spaces`."""
    data = document.get("data") if isinstance(document, dict) else None
    return isinstance(data, dict) and any(isinstance(data.get(key), list) for key in ("zones", "spaces"))


def read_curbs(documents: list[Any], source: str, georeference: Georeference | None) -> tuple[DrawnSpots, Counter[str]]:
    """Spots of the answers (several pages, zones and spaces together), and what was left out, by reason.

    A space is a spot. A zone none of whose spaces is drawn is cut into `num_spaces`, or into spots of the usual size.

    Raises:
        MapFileError: a polygon that is none, or no space at all.
    """
    spaces = [item for document in documents for item in document["data"].get("spaces") or []]
    zones = [item for document in documents for item in document["data"].get("zones") or []]
    left_out: Counter[str] = Counter()
    angles = {str(_of(zone, "curb_zone_id")): _angle(zone) for zone in zones}
    columns: list[tuple[str, str, Any]] = []
    for number, space in enumerate(spaces):
        kind = angles.get(str(_of(space, "curb_zone_id"))) or "unknown"
        columns.append((_name(space, number), kind, _ring(space, f"{source}: space {number}")))
    drawn = {str(_of(space, "curb_zone_id")) for space in spaces}
    undrawn = [zone for zone in zones if str(_of(zone, "curb_zone_id")) not in drawn]
    rings = [ring for _, _, ring in columns] + [_ring(zone, f"{source}: zone {n}") for n, zone in enumerate(undrawn)]
    if not rings:
        raise MapFileError(f"{source}: no curb space or zone in it")
    georeference = georeference or middle_of(rings)
    for zone, ring in zip(undrawn, rings[len(columns) :], strict=True):
        cut = _cut(zone, ring, georeference)
        left_out["zones that cannot be cut into spaces"] += not cut
        columns += cut
    if not columns:
        raise MapFileError(f"{source}: no curb space in it, and no zone that can be cut into spaces")
    ids, kinds, shapes = zip(*columns, strict=True)
    return DrawnSpots(ids, kinds, shapes, georeference), +left_out


def _of(item: Any, key: str) -> Any:
    return item.get(key) if isinstance(item, dict) else None


def _angle(zone: Any) -> str | None:
    angle = _of(zone, "parking_angle")
    return angle if angle in _ANGLES else None


def _name(space: Any, number: int) -> str:
    """The id that our own service gives spots, else that of the space."""
    attributes = _of(space, "custom_attributes")
    for name in (_of(attributes, "spot_id"), _of(space, "curb_space_id")):
        if isinstance(name, str) and is_good_id(name):
            return name
    return f"space-{number + 1}"


def _ring(item: Any, source: str) -> Any:
    return outer_ring({"geometry": _of(item, "geometry")}, source)


def _cut(zone: Any, ring: Any, georeference: Georeference) -> list[tuple[str, str, Any]]:
    area = shapely.Polygon(georeference.to_map(ring)[:, :2])
    if not area.is_valid or area.area < 1.0:
        return []
    told = _of(zone, "num_spaces")
    count = told if isinstance(told, int) and 0 < told <= MOST_SPACES else None
    cells, kind = area_into_spots(area, None, _angle(zone), count)
    name = _of(zone, "curb_zone_id")
    name = name if isinstance(name, str) and is_good_id(name) else "zone"
    outlines = [georeference.to_lon_lat(np.asarray(cell.exterior.coords)[:, :2]) for cell in cells]
    return [(f"{name}-{number}", kind, outline) for number, outline in enumerate(outlines, start=1)]
