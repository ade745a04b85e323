"""Reads streets, buildings, areas and trees from GeoJSON that may say anything."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.world.errors import MapFileError
from autowaze.world.georeference import Georeference
from autowaze.world.streets import (
    DEFAULT_CROWN_M,
    DEFAULT_HEIGHT_M,
    DEFAULT_SPEED_KMH,
    DEFAULT_WIDTH_M,
    Footprints,
    StreetNetwork,
    Streets,
    Trees,
    areas,
    buildings,
    streets,
)

MOST_FEATURES = 1_000_000
MOST_POSITIONS = 10_000_000
MOST_BYTES = 1 << 30
FARTHEST_M = 1e6
LONGEST_NAME = 200

_SHAPE_OF = {"street": "LineString", "building": "Polygon", "area": "Polygon", "tree": "Point"}


class _Reader:
    """Gathers the positions of all features, so that they are taken to the map at once."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._positions: list[Any] = []
        self._ends: list[int] = []
        self._properties: dict[str, list[dict[str, Any]]] = {kind: [] for kind in _SHAPE_OF}
        self._rings: dict[str, list[int]] = {kind: [] for kind in _SHAPE_OF}
        self._number: dict[str, list[int]] = {kind: [] for kind in _SHAPE_OF}

    def read(self, features: list[Any], georeference: Georeference | None) -> StreetNetwork:
        for number, feature in enumerate(features):
            self._take(number, feature)
        try:
            lon_lat = np.array([position[:2] for position in self._positions], dtype=np.float64).reshape(-1, 2)
        except (TypeError, ValueError, KeyError, OverflowError) as error:
            raise MapFileError(f"{self._source}: a position is not [longitude, latitude]") from error
        if not (np.abs(lon_lat) <= [180.0, 90.0]).all():  # refuses what is not a number, too
            bad = int(np.argmin((np.abs(lon_lat) <= [180.0, 90.0]).all(axis=1)))
            raise MapFileError(f"{self._source}: {self._positions[bad]} is no longitude and latitude in degrees")
        if georeference is None:
            if len(lon_lat) == 0:
                raise MapFileError(f"{self._source}: no street, building, area or tree")
            georeference = Georeference(float(lon_lat[0, 1]), float(lon_lat[0, 0]))
        points = georeference.to_map(lon_lat)[:, :2]
        if len(points) and np.abs(points).max() > FARTHEST_M:
            raise MapFileError(f"{self._source}: lies more than 1000 km from the origin of the map")
        pieces = np.split(points, self._ends[:-1]) if self._ends else []
        return StreetNetwork(
            georeference,
            self._streets(pieces),
            self._footprints("building", pieces),
            self._footprints("area", pieces),
            self._trees(pieces),
        )

    def _take(self, number: int, feature: Any) -> None:
        try:
            properties = feature.get("properties") or {}
            kind = properties.get("kind")
            if kind not in _SHAPE_OF:
                return  # of another program
            geometry = feature["geometry"]
            shape, coordinates = geometry["type"], geometry["coordinates"]
            if shape != _SHAPE_OF[kind]:
                raise MapFileError(f"{self._source}: feature {number}: a {kind} is a {_SHAPE_OF[kind]}, not a {shape}")
            if shape == "Polygon":
                coordinates = coordinates[0]
            elif shape == "Point":
                coordinates = [coordinates]
            least = {"LineString": 2, "Polygon": 4, "Point": 1}[shape]
            if not isinstance(coordinates, list) or len(coordinates) < least:
                raise MapFileError(f"{self._source}: feature {number}: a {kind} needs {least} positions or more")
        except (AttributeError, KeyError, TypeError, IndexError) as error:
            raise MapFileError(f"{self._source}: feature {number}: not a GeoJSON feature") from error
        self._positions.extend(coordinates)
        if len(self._positions) > MOST_POSITIONS:
            raise MapFileError(f"{self._source}: more than {MOST_POSITIONS} positions: simplify the lines")
        self._rings[kind].append(len(self._ends))
        self._ends.append(len(self._positions))
        self._properties[kind].append(properties)
        self._number[kind].append(number)

    def _streets(self, pieces: list[NDArray[np.float64]]) -> Streets:
        lines = [shapely.LineString(pieces[row]) for row in self._rings["street"]]
        for number, line in zip(self._number["street"], lines, strict=True):
            if line.length == 0.0:
                raise MapFileError(f"{self._source}: feature {number}: a street without length")
        return streets(
            lines,
            self._texts("street", "name"),
            self._flags("street", "oneway", False),
            self._numbers("street", "speed_kmh", DEFAULT_SPEED_KMH, 1.0, 200.0),
            self._numbers("street", "width_m", DEFAULT_WIDTH_M, 0.1, 200.0),
            self._flags("street", "walking", True),
            self._flags("street", "driving", True),
        )

    def _footprints(self, kind: str, pieces: list[NDArray[np.float64]]) -> Footprints:
        outlines = [shapely.Polygon(pieces[row]) for row in self._rings[kind]]
        if kind == "area":
            return areas(outlines, self._texts(kind, "surface"))
        return buildings(outlines, self._numbers(kind, "height_m", DEFAULT_HEIGHT_M, 0.0, 1000.0))

    def _trees(self, pieces: list[NDArray[np.float64]]) -> Trees:
        position = np.array([pieces[row][0] for row in self._rings["tree"]]).reshape(-1, 2)
        return Trees(position, np.array(self._numbers("tree", "radius_m", DEFAULT_CROWN_M, 0.0, 50.0)))

    def _texts(self, kind: str, name: str) -> list[str]:
        found = [properties.get(name) for properties in self._properties[kind]]
        return ["" if text is None else str(text)[:LONGEST_NAME] for text in found]

    def _flags(self, kind: str, name: str, default: bool) -> list[bool]:
        found = []
        for number, properties in zip(self._number[kind], self._properties[kind], strict=True):
            value = properties.get(name, default)
            if not isinstance(value, bool):
                raise MapFileError(f"{self._source}: feature {number}: {name} is true or false, not {value!r:.50}")
            found.append(value)
        return found

    def _numbers(self, kind: str, name: str, default: float, low: float, high: float) -> list[float]:
        found = []
        for number, properties in zip(self._number[kind], self._properties[kind], strict=True):
            value = properties.get(name)
            value = default if value is None else value
            good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
            if not good or not low <= value <= high:
                raise MapFileError(
                    f"{self._source}: feature {number}: {name} is a number from {low:g} to {high:g}, not {value!r:.50}"
                )
            found.append(float(value))
        return found


def parse(path: Path) -> Any:
    """The JSON document in a file; raises `MapFileError`."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise MapFileError(f"{path}: larger than {MOST_BYTES >> 20} MiB: cut the city into smaller pieces")
        return json.loads(path.read_bytes())
    except OSError as error:
        raise MapFileError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise MapFileError(f"{path}: not JSON: {error}") from error


def read_document(document: Any, source: str, georeference: Georeference | None) -> StreetNetwork:
    """The network in a parsed document; raises `MapFileError`."""
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list) or not features:
        raise MapFileError(f"{source}: expected a GeoJSON FeatureCollection of streets and buildings")
    if len(features) > MOST_FEATURES:
        raise MapFileError(f"{source}: more than {MOST_FEATURES} features: cut the city into smaller pieces")
    member = document.get("georeference")
    if georeference is None and member is not None:
        georeference = _georeference(member, source)
    return _Reader(source).read(features, georeference)


def _georeference(member: Any, source: str) -> Georeference:
    try:
        return Georeference(float(member["lat"]), float(member["lon"]), float(member.get("altitude_m", 0.0)))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise MapFileError(f"{source}: georeference: needs numbers lat and lon in degrees") from error
