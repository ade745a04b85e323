"""Pre-annotated parking spots and what is believed of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from autowaze.world.drawn_spots import DrawnSpots, load_document, read_drawn_spots
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


@dataclass(frozen=True, slots=True)
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

    @property
    def plain(self) -> tuple[str, str, float, float | None, str]:
        """The same as text and numbers."""
        return self.spot_id, self.occupancy.value, self.probability_vacant, self.observed_at, self.evidence

    @classmethod
    def of_plain(cls, plain: Sequence[Any]) -> SpotState:
        """The state that `plain` describes."""
        spot_id, occupancy, *rest = plain
        return cls(spot_id, Occupancy(occupancy), *rest)


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
        return cls.from_document(load_document(path), str(path), georeference)

    @classmethod
    def from_document(cls, document: Any, source: str, georeference: Georeference | None = None) -> ParkingMap:
        """Spots of a parsed GeoJSON document; `source` names it in errors."""
        return cls.from_drawn(read_drawn_spots(document, source, georeference), source)

    @classmethod
    def from_drawn(cls, drawn: DrawnSpots, source: str) -> ParkingMap:
        """Spots that somebody drew; raises `MapFileError` unless each is a simple polygon with an id of its own."""
        outlines = drawn.outlines
        wrong = np.flatnonzero(~(shapely.is_valid(outlines) & (shapely.area(outlines) > 0)))
        if len(wrong):
            raise MapFileError(f"{source}: feature {wrong[0]}: the polygon crosses itself or has no area")
        spots = tuple(ParkingSpot(*row) for row in zip(drawn.ids, outlines.tolist(), drawn.kinds, strict=True))
        return cls(spots, drawn.georeference, drawn.heading_rad)

    @property
    def drawn(self) -> DrawnSpots:
        """The spots as they would be drawn anew, rings counter-clockwise (RFC 7946, sec. 3.1.6)."""
        outlines = shapely.orient_polygons(np.array([spot.polygon for spot in self.spots], dtype=np.object_))
        points, owner = shapely.get_coordinates(shapely.get_exterior_ring(outlines), return_index=True)
        starts = np.flatnonzero(np.diff(owner)) + 1
        rings = np.split(self.georeference.to_lon_lat(points), starts) if self.spots else []
        ids, kinds = tuple(spot.id for spot in self.spots), tuple(spot.kind for spot in self.spots)
        return DrawnSpots(ids, kinds, tuple(rings), self.georeference, self.survey_heading_rad)
