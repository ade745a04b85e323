"""Parking maps from GeoJSON: our own, and collections of polygons with whatever properties."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from autowaze.world.drawn_spots import MOST_SPOTS, DrawnSpots, outer_ring, read_drawn_spots
from autowaze.world.errors import MapFileError
from autowaze.world.georeference import Georeference
from autowaze.world.spot_check import is_good_id
from autowaze.world.surveys.kerb_rules import kind_of

_ID_KEYS = ("spot_id", "id", "@id", "space_id", "bay_id", "objectid", "OBJECTID", "fid", "ref", "name")
_KIND_KEYS = ("kind", "orientation", "parking:orientation", "parking_angle", "type")
_KINDS = ("parallel", "perpendicular", "angled")


def read_polygons(
    documents: list[Any], source: str, georeference: Georeference | None
) -> tuple[DrawnSpots, Counter[str]]:
    """Spots of one or several feature collections, and what was left out, by reason.

    Without a georeference of its own, given or in the first document, the map's origin is the middle of the spots.

    Raises:
        MapFileError: no feature collection, or one without polygons.
    """
    features: list[dict[str, Any]] = []
    left_out: Counter[str] = Counter()
    for document in documents:
        if not isinstance(document, dict) or not isinstance(document.get("features"), list):
            raise MapFileError(f"{source}: expected a GeoJSON FeatureCollection")
        for feature in document["features"]:
            features += _polygons(feature, left_out)
        if len(features) > MOST_SPOTS:
            raise MapFileError(f"{source}: more than {MOST_SPOTS} polygons: cut out the area that you need")
    if not features:
        raise MapFileError(f"{source}: no polygon in it, so no spot")
    member = documents[0].get("georeference")
    if georeference is None and not isinstance(member, dict):
        georeference = middle_of([outer_ring(one, f"{source}: feature {n}") for n, one in enumerate(features)])
    taken: set[str] = set()
    named = [_named(feature, number, taken) for number, feature in enumerate(features, start=1)]
    document = {"features": named} | ({"georeference": member} if isinstance(member, dict) else {})
    return read_drawn_spots(document, source, georeference), left_out


def middle_of(rings: list[np.ndarray[Any, np.dtype[np.float64]]]) -> Georeference:
    """The middle of the box around rings in lon, lat degrees, to a metre or so."""
    points = np.concatenate(rings)
    lon, lat = (points.min(axis=0) + points.max(axis=0)) / 2
    return Georeference(round(float(lat), 5), round(float(lon), 5))


def _polygons(feature: Any, left_out: Counter[str]) -> list[dict[str, Any]]:
    """The feature for each of its polygons."""
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind == "Polygon":
        return [feature]
    if kind == "MultiPolygon" and isinstance(geometry, dict) and isinstance(geometry.get("coordinates"), list):
        parts = geometry["coordinates"]
        return [{**feature, "geometry": {"type": "Polygon", "coordinates": part}} for part in parts]
    left_out[f"features: {str(kind)[:30]} is no polygon"] += 1
    return []


def _named(feature: dict[str, Any], number: int, taken: set[str]) -> dict[str, Any]:
    """The feature with an id of its own and a kind that we know."""
    properties = feature.get("properties")
    properties = properties if isinstance(properties, dict) else {}
    told = (properties.get(key) for key in _ID_KEYS)
    candidates = [str(value) for value in (properties.get("spot_id"), feature.get("id"), *told) if value is not None]
    spot_id = next((name for name in candidates if is_good_id(name)), f"spot-{number}")
    own, again = spot_id, 2
    while own in taken:
        own, again = f"{spot_id}-{again}", again + 1
    taken.add(own)
    kinds = [str(properties[key]) for key in _KIND_KEYS if key in properties]
    known = [kind if kind in _KINDS else kind_of(kind) for kind in kinds]
    kind = next((kind for kind in known if kind), "unknown")
    return {"geometry": feature["geometry"], "properties": {"spot_id": own, "kind": kind}}
