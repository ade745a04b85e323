"""Parking spots as somebody drew them, before anybody looked whether they make sense."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.errors import MapFileError
from autowaze.world.georeference import Georeference

MOST_BYTES = 1 << 29
MOST_SPOTS = 1_000_000
MOST_CORNERS = 1000
LONGEST_ID = 200
_ROUND_DIGITS = 9


@dataclass(frozen=True)
class DrawnSpots:
    """N outlines with names; they may cross themselves, lie on each other, share ids or be mere slivers.

    Attributes:
        ids, kinds: (N,) str.
        rings: N outer rings (K, 2) in lon, lat degrees, closed as they came.
        georeference: origin of the map frame.
        heading_rad: compass heading of the survey camera that the origin stands for, if there is one.
    """

    ids: tuple[str, ...]
    kinds: tuple[str, ...]
    rings: tuple[NDArray[np.float64], ...]
    georeference: Georeference
    heading_rad: float | None = None

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def outlines(self) -> NDArray[np.object_]:
        """Shapely polygons (N,) in map metres; not all need be valid."""
        if not self.rings:
            return np.empty(0, dtype=np.object_)
        points = self.georeference.to_map(np.concatenate(self.rings))[:, :2]
        owner = np.repeat(np.arange(len(self.rings)), [len(ring) for ring in self.rings])
        return np.asarray(shapely.polygons(shapely.linearrings(points, indices=owner)), dtype=np.object_)


def load_document(path: str | Path, most_bytes: int = MOST_BYTES) -> Any:
    """A parsed JSON file.

    Raises:
        MapFileError: the file is missing, too large or no JSON.
    """
    path = Path(path)
    try:
        if path.stat().st_size > most_bytes:
            raise MapFileError(f"{path}: larger than {most_bytes >> 20} MiB: cut out the area that you need")
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise MapFileError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise MapFileError(f"{path}: not JSON: {error}") from error


def read_drawn_spots(document: Any, source: str, georeference: Georeference | None = None) -> DrawnSpots:
    """Spots of a parsed GeoJSON feature collection of polygons; `source` names it in errors.

    The map's origin is the one given, else the document's top-level `georeference` member, else the first vertex.

    Raises:
        MapFileError: no feature collection of polygons in degrees.
    """
    if not isinstance(document, dict) or not isinstance(document.get("features"), list) or not document["features"]:
        raise MapFileError(f"{source}: expected a GeoJSON FeatureCollection with at least one spot")
    features = document["features"]
    if len(features) > MOST_SPOTS:
        raise MapFileError(f"{source}: more than {MOST_SPOTS} features: cut out the area that you need")
    rings = tuple(outer_ring(feature, f"{source}: feature {i}") for i, feature in enumerate(features))
    heading = None
    member = document.get("georeference")
    if isinstance(member, dict):
        georeference = georeference or _read_georeference(member, source)
        heading = _read_heading(member, source)
    georeference = georeference or Georeference(float(rings[0][0, 1]), float(rings[0][0, 0]))
    named = [_name(feature, number) for number, feature in enumerate(features)]
    return DrawnSpots(tuple(n for n, _ in named), tuple(k for _, k in named), rings, georeference, heading)


def outer_ring(feature: Any, source: str) -> NDArray[np.float64]:
    """Outer ring (N, 2) in lon, lat degrees of one GeoJSON feature; `source` names it in errors."""
    try:
        geometry = feature["geometry"]
        if geometry["type"] != "Polygon":
            raise MapFileError(f"{source}: a spot is a Polygon, not a {str(geometry['type'])[:LONGEST_ID]}")
        corners = geometry["coordinates"][0]
        if len(corners) > MOST_CORNERS:
            raise MapFileError(f"{source}: more than {MOST_CORNERS} corners")
        ring = np.array([point[:2] for point in corners], dtype=np.float64)
    except (KeyError, TypeError, IndexError, ValueError, OverflowError) as error:
        raise MapFileError(f"{source}: not a GeoJSON polygon feature") from error
    if ring.ndim != 2 or ring.shape[1:] != (2,) or len(ring) < 4 or not (np.abs(ring) <= [180.0, 90.0]).all():
        raise MapFileError(f"{source}: a ring needs four lon, lat positions or more, in degrees")
    return ring


def document_of(drawn: DrawnSpots) -> dict[str, Any]:
    """The spots as an RFC 7946 feature collection with their georeference."""
    member: dict[str, float] = {
        "lat": drawn.georeference.lat_deg,
        "lon": drawn.georeference.lon_deg,
        "altitude_m": drawn.georeference.altitude_m,
    }
    if drawn.heading_rad is not None:
        member["heading_deg"] = float(np.degrees(drawn.heading_rad))
    columns = zip(drawn.ids, drawn.kinds, drawn.rings, strict=True)
    features = [feature_of(spot_id, kind, ring) for spot_id, kind, ring in columns]
    return {"type": "FeatureCollection", "georeference": member, "features": features}


def feature_of(spot_id: str, kind: str, ring: NDArray[np.float64]) -> dict[str, Any]:
    """One spot as a GeoJSON feature, from its closed ring (N, 2) in lon, lat degrees."""
    return {
        "type": "Feature",
        "id": spot_id,
        "geometry": {"type": "Polygon", "coordinates": [np.round(ring, _ROUND_DIGITS).tolist()]},
        "properties": {"spot_id": spot_id, "kind": kind},
    }


def _name(feature: dict[str, Any], number: int) -> tuple[str, str]:
    properties = feature.get("properties")
    properties = properties if isinstance(properties, dict) else {}
    spot_id, kind = properties.get("spot_id") or feature.get("id"), properties.get("kind")
    return str(number if spot_id is None else spot_id), str(kind or "unknown")


def _read_georeference(member: dict[str, Any], source: str) -> Georeference:
    try:
        return Georeference(float(member["lat"]), float(member["lon"]), float(member.get("altitude_m", 0.0)))
    except (KeyError, TypeError, ValueError) as error:
        raise MapFileError(f"{source}: georeference: needs numbers lat and lon in degrees") from error


def _read_heading(member: dict[str, Any], source: str) -> float | None:
    try:
        heading = member.get("heading_deg")
        return None if heading is None else float(np.radians(float(heading)))
    except (TypeError, ValueError) as error:
        raise MapFileError(f"{source}: georeference: heading_deg is no number") from error
