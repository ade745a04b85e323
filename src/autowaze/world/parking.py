"""Pre-annotated parking spots and what is believed of them."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from autowaze.world.errors import MapFileError
from autowaze.world.georeference import Georeference


class Occupancy(StrEnum):
    """State of a spot; one that nobody looked at is unknown, never vacant."""

    VACANT = "vacant"
    OCCUPIED = "occupied"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class ParkingSpot:
    """One spot.

    Attributes:
        id: unique in its parking map.
        polygon: outline in map metres (east, north).
        kind: parallel, perpendicular, angled or unknown.
    """

    id: str
    polygon: Polygon
    kind: str = "unknown"

    @property
    def centre(self) -> NDArray[np.float64]:
        """Centroid (2,) in map metres."""
        return np.array([self.polygon.centroid.x, self.polygon.centroid.y])


@dataclass(frozen=True)
class SpotState:
    """What is believed of one spot.

    Attributes:
        occupancy: the decision.
        probability_vacant: 0..1.
        observed_at: time of the last evidence, seconds since the epoch (UTC); None if there never was any.
        evidence: one line for a person.
    """

    spot_id: str
    occupancy: Occupancy
    probability_vacant: float = 0.5
    observed_at: float | None = None
    evidence: str = ""


@dataclass(frozen=True)
class ParkingMap:
    """The spots of an area in one map frame.

    Attributes:
        spots: in file order.
        georeference: origin of the map frame that the polygons are in.
        survey_heading_rad: compass heading of the survey camera that the file's origin stands for, if it has one.
    """

    spots: tuple[ParkingSpot, ...]
    georeference: Georeference
    survey_heading_rad: float | None = None
    by_id: dict[str, ParkingSpot] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_id", {spot.id: spot for spot in self.spots})
        if len(self.by_id) != len(self.spots):
            raise MapFileError("two parking spots share an id")

    def __len__(self) -> int:
        return len(self.spots)

    @classmethod
    def from_geojson(cls, path: str | Path, georeference: Georeference | None = None) -> ParkingMap:
        """Read spots from an RFC 7946 file of polygons.

        The map's origin is the one given, else the file's top-level `georeference` member, else the first vertex.

        Raises:
            MapFileError: the file is missing or is not a feature collection of simple polygons.
        """
        path = Path(path)
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise MapFileError(f"{path}: cannot be read: {error.strerror}") from error
        except ValueError as error:
            raise MapFileError(f"{path}: not JSON: {error}") from error
        return cls.from_document(document, str(path), georeference)

    @classmethod
    def from_document(cls, document: Any, source: str, georeference: Georeference | None = None) -> ParkingMap:
        """Spots of a parsed GeoJSON document; `source` names it in errors."""
        if not isinstance(document, dict) or not isinstance(document.get("features"), list) or not document["features"]:
            raise MapFileError(f"{source}: expected a GeoJSON FeatureCollection with at least one spot")
        rings = [_outer_ring(feature, source, i) for i, feature in enumerate(document["features"])]
        member = document.get("georeference")
        heading = None
        if isinstance(member, dict):
            georeference = georeference or _read_georeference(member, source)
            heading = member.get("heading_deg")
        georeference = georeference or Georeference(float(rings[0][0, 1]), float(rings[0][0, 0]))
        spots = []
        for i, (feature, ring) in enumerate(zip(document["features"], rings, strict=True)):
            polygon = Polygon(georeference.to_map(ring)[:, :2])
            if not polygon.is_valid or polygon.area <= 0:
                raise MapFileError(f"{source}: feature {i}: the polygon crosses itself or has no area")
            properties = feature.get("properties") or {}
            spot_id = str(properties.get("spot_id") or feature.get("id") or i)
            spots.append(ParkingSpot(spot_id, polygon, str(properties.get("kind") or "unknown")))
        return cls(tuple(spots), georeference, None if heading is None else float(np.radians(float(heading))))


def _outer_ring(feature: Any, source: str, index: int) -> NDArray[np.float64]:
    """Outer ring (N, 2) in lon, lat degrees of one GeoJSON feature."""
    try:
        geometry = feature["geometry"]
        if geometry["type"] != "Polygon":
            raise MapFileError(f"{source}: feature {index}: a spot is a Polygon, not a {geometry['type']}")
        ring = np.array([point[:2] for point in geometry["coordinates"][0]], dtype=np.float64)
    except (KeyError, TypeError, IndexError, ValueError) as error:
        raise MapFileError(f"{source}: feature {index}: not a GeoJSON polygon feature") from error
    if ring.ndim != 2 or len(ring) < 4 or not np.isfinite(ring).all() or (np.abs(ring) > [180.0, 90.0]).any():
        raise MapFileError(f"{source}: feature {index}: a ring needs four lon, lat positions or more, in degrees")
    return ring


def _read_georeference(member: dict[str, Any], source: str) -> Georeference:
    try:
        return Georeference(float(member["lat"]), float(member["lon"]), float(member.get("altitude_m", 0.0)))
    except (KeyError, TypeError, ValueError) as error:
        raise MapFileError(f"{source}: georeference: needs numbers lat and lon in degrees") from error
