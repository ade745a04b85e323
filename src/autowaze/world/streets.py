"""Streets, buildings and what else a map shows around the parking spots; read from and written as GeoJSON.

One feature collection holds everything; `properties.kind` says what a feature is:

- `street`: LineString in driving direction; `name`, `oneway`, `speed_kmh`, `width_m`, and `walking`, `driving`, which
  are true unless told otherwise.
- `building`: Polygon; `height_m`.
- `area`: Polygon; `surface` (asphalt, pavement, grass, water, parking, ...).
- `tree`: Point; `radius_m` of the crown.

Streets join where they share a position, so a bridge has none in common with the street below it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.columns import Columns
from autowaze.world.georeference import Georeference

DEFAULT_SPEED_KMH, DEFAULT_WIDTH_M, DEFAULT_HEIGHT_M, DEFAULT_CROWN_M = 30.0, 6.0, 8.0, 2.0
DIGITS = 7
"""Of degrees: a centimetre (RFC 7946, sec. 11.2)."""


@dataclass
class Streets(Columns):
    """N centre lines.

    Attributes:
        line: (N,) shapely LineStrings in map metres, in driving direction.
        name: (N,) str, empty where there is none.
        oneway: (N,) bool, for who drives; who walks may go both ways.
        speed_kmh: (N,) float64, what may be driven.
        width_m: (N,) float64, kerb to kerb.
        walking, driving: (N,) bool, who may use it.
    """

    line: NDArray[np.object_]
    name: NDArray[np.object_]
    oneway: NDArray[np.bool_]
    speed_kmh: NDArray[np.float64]
    width_m: NDArray[np.float64]
    walking: NDArray[np.bool_]
    driving: NDArray[np.bool_]


@dataclass
class Footprints(Columns):
    """N outlines: buildings with their height, or areas with their surface.

    Attributes:
        outline: (N,) shapely Polygons in map metres.
        surface: (N,) str, empty for buildings.
        height_m: (N,) float64, 0 for areas.
    """

    outline: NDArray[np.object_]
    surface: NDArray[np.object_]
    height_m: NDArray[np.float64]


@dataclass
class Trees(Columns):
    """N trees.

    Attributes:
        position: (N, 2) float64, map metres.
        radius_m: (N,) float64, of the crown.
    """

    position: NDArray[np.float64]
    radius_m: NDArray[np.float64]


def streets(
    lines: Sequence[shapely.LineString],
    names: Sequence[str] | None = None,
    oneway: Sequence[bool] | None = None,
    speed_kmh: Sequence[float] | None = None,
    width_m: Sequence[float] | None = None,
    walking: Sequence[bool] | None = None,
    driving: Sequence[bool] | None = None,
) -> Streets:
    """Streets of lines in map metres; what is not given is what the constants of this module say."""
    n = len(lines)
    return Streets(
        _objects(lines),
        _objects(names if names is not None else [""] * n),
        np.asarray(oneway if oneway is not None else np.zeros(n), dtype=np.bool_),
        np.asarray(speed_kmh if speed_kmh is not None else np.full(n, DEFAULT_SPEED_KMH), dtype=np.float64),
        np.asarray(width_m if width_m is not None else np.full(n, DEFAULT_WIDTH_M), dtype=np.float64),
        np.asarray(walking if walking is not None else np.ones(n), dtype=np.bool_),
        np.asarray(driving if driving is not None else np.ones(n), dtype=np.bool_),
    )


def buildings(outlines: Sequence[shapely.Polygon], height_m: Sequence[float] | None = None) -> Footprints:
    """Buildings of outlines in map metres."""
    n = len(outlines)
    heights = np.full(n, DEFAULT_HEIGHT_M) if height_m is None else np.asarray(height_m, dtype=np.float64)
    return Footprints(_objects(outlines), _objects([""] * n), heights)


def areas(outlines: Sequence[shapely.Polygon], surfaces: Sequence[str]) -> Footprints:
    """Areas of outlines in map metres."""
    return Footprints(_objects(outlines), _objects(surfaces), np.zeros(len(outlines)))


@dataclass(frozen=True)
class StreetNetwork:
    """What a map of the city shows besides its parking spots, all in one map frame."""

    georeference: Georeference
    streets: Streets = field(default_factory=lambda: streets([]))
    buildings: Footprints = field(default_factory=lambda: buildings([]))
    areas: Footprints = field(default_factory=lambda: areas([], []))
    trees: Trees = field(default_factory=lambda: Trees(np.zeros((0, 2)), np.zeros(0)))

    def __len__(self) -> int:
        """How many features there are of all kinds."""
        return len(self.streets) + len(self.buildings) + len(self.areas) + len(self.trees)

    @classmethod
    def from_geojson(cls, path: str | Path, georeference: Georeference | None = None) -> StreetNetwork:
        """Read a file; the map's origin is the one given, else the file's `georeference`, else its first position.

        Raises:
            MapFileError: the file is missing, too large, or not such a feature collection.
        """
        from autowaze.world.street_reader import parse

        return cls.from_document(parse(Path(path)), str(path), georeference)

    @classmethod
    def from_document(cls, document: Any, source: str, georeference: Georeference | None = None) -> StreetNetwork:
        """Streets of a parsed GeoJSON document, as `from_geojson`; `source` names it in errors."""
        from autowaze.world.street_reader import read_document

        return read_document(document, source, georeference)

    def to_document(self) -> dict[str, Any]:
        """The network as a GeoJSON feature collection, longitude and latitude."""
        origin = self.georeference
        return {
            "type": "FeatureCollection",
            "georeference": {"lat": origin.lat_deg, "lon": origin.lon_deg, "altitude_m": origin.altitude_m},
            "features": list(self.features()),
        }

    def to_geojson(self, path: str | Path) -> None:
        """Write the network to a file."""
        Path(path).write_text(json.dumps(self.to_document(), separators=(",", ":"), allow_nan=False), encoding="utf-8")

    def geometries(self) -> NDArray[np.object_]:
        """Shapes (N,) in lon/lat of everything, in the order of `features`: streets, buildings, areas, trees."""
        points = shapely.points(self.trees.position)
        outlines = np.concatenate([self.buildings.outline, self.areas.outline])
        shapes = np.concatenate([self.streets.line, shapely.orient_polygons(outlines), points])
        return np.asarray(shapely.transform(shapes, self._to_lon_lat), dtype=np.object_)

    def features(self) -> Iterator[dict[str, Any]]:
        """Everything as GeoJSON features."""
        shapes = shapely.to_geojson(self.geometries()).tolist()
        for shape, properties in zip(shapes, self._properties(), strict=True):
            yield {"type": "Feature", "geometry": json.loads(shape), "properties": properties}

    def _properties(self) -> Iterator[dict[str, Any]]:
        s = self.streets
        columns = (s.name, s.oneway.tolist(), s.speed_kmh.tolist(), s.width_m.tolist(), s.walking, s.driving)
        for name, oneway, speed, width, walking, driving in zip(*columns, strict=True):
            found = {"kind": "street", "name": name, "oneway": oneway, "speed_kmh": speed, "width_m": round(width, 2)}
            yield found | ({} if walking else {"walking": False}) | ({} if driving else {"driving": False})
        for height in self.buildings.height_m.tolist():
            yield {"kind": "building", "height_m": round(height, 2)}
        for surface in self.areas.surface:
            yield {"kind": "area", "surface": surface}
        for radius in self.trees.radius_m.tolist():
            yield {"kind": "tree", "radius_m": round(radius, 2)}

    def _to_lon_lat(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.round(self.georeference.to_lon_lat(points), DIGITS)


def _objects(items: Iterable[Any]) -> NDArray[np.object_]:
    found = list(items)
    column = np.empty(len(found), dtype=np.object_)
    column[:] = found
    return column
