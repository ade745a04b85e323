"""OpenStreetMap extracts (.osm, .osm.bz2, .osm.gz, .osm.pbf): what of them bears on parking.

libosmium reads them. Two passes over the file find the ways, then the nodes that these need, so that memory grows with
what is kept and not with the file. XML entities are refused by libosmium; compressed text is unpacked to a bound first.
"""

from __future__ import annotations

import bz2
import gzip
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import DependencyError, MapFileError

MOST_BYTES = 1 << 30
MOST_UNPACKED_BYTES = 4 << 30
MOST_WAYS = 1_000_000
MOST_NODES = 10_000_000
_CHUNK = 1 << 20
_WAY_KEYS = ("highway", "building", "amenity")
_NODE_KEYS = ("highway", "amenity", "public_transport")

Box = tuple[float, float, float, float]
"""West, south, east, north in degrees."""
Tags = dict[str, str]


@dataclass(frozen=True)
class OsmWay:
    """A way whose nodes are all known.

    Attributes:
        nodes: ids.
        lon_lat: (N, 2) degrees.
    """

    id: int
    tags: Tags
    nodes: tuple[int, ...]
    lon_lat: NDArray[np.float64]

    @property
    def is_closed(self) -> bool:
        """Whether it may be an area."""
        return len(self.nodes) >= 4 and self.nodes[0] == self.nodes[-1]


@dataclass(frozen=True)
class OsmNode:
    """A node with tags."""

    id: int
    tags: Tags
    lon: float
    lat: float


@dataclass(frozen=True)
class OsmExtract:
    """Streets, buildings, parking areas and what stands at the kerb, in the order of the file.

    Attributes:
        outlines: rings of multipolygon relations as closed ways; their ids are those of the relations, negated.
        incomplete: ways of which a node lies outside the extract.
    """

    ways: tuple[OsmWay, ...]
    outlines: tuple[OsmWay, ...]
    nodes: tuple[OsmNode, ...]
    incomplete: int


def read_osm(path: str | Path, box: Box | None = None) -> OsmExtract:
    """What lies, in part at least, in a box; all of it without one.

    Raises:
        MapFileError: the file is missing, too large, or no OpenStreetMap extract.
        DependencyError: pyosmium is not installed.
    """
    path = Path(path)
    try:
        import osmium
    except ImportError as error:
        raise DependencyError("OpenStreetMap extracts need pyosmium: pip install osmium") from error
    try:
        if path.stat().st_size > MOST_BYTES:
            raise MapFileError(f"{path}: larger than {MOST_BYTES >> 30} GiB: cut out the area with osmium extract")
        with _unpacked(path) as plain:
            return _read(osmium, plain, box)
    except OSError as error:
        raise MapFileError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (RuntimeError, ValueError, EOFError, osmium.InvalidLocationError) as error:
        raise MapFileError(f"{path}: no OpenStreetMap extract: {str(error)[:200]}") from error


@contextmanager
def _unpacked(path: Path) -> Iterator[Path]:
    """The file, unpacked if it is compressed text: bz2 can blow a megabyte up to terabytes."""
    openers: dict[str, Any] = {".bz2": bz2.open, ".gz": gzip.open}
    opener = openers.get(path.suffix)
    if opener is None:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "extract.osm"
        size = 0
        with opener(path, "rb") as packed, plain.open("wb") as unpacked:
            while chunk := packed.read(_CHUNK):
                size += len(chunk)
                if size > MOST_UNPACKED_BYTES:
                    raise MapFileError(f"{path}: unpacks to more than {MOST_UNPACKED_BYTES >> 30} GiB: use .osm.pbf")
                unpacked.write(chunk)
        yield plain


@dataclass
class _Line:
    id: int
    tags: Tags
    nodes: list[int]


def _read(osmium: Any, path: Path, box: Box | None) -> OsmExtract:
    relations, members = _relations(osmium, path)
    lines, needed = _lines(osmium, path, members)
    places, tagged = _places(osmium, path, needed, box)
    inside = None if box is None else _inside(places, box)
    ways, outlines, incomplete = [], [], 0
    by_id = {line.id: line for line in lines}
    for line in lines:
        if line.tags:
            way = _placed(line, places)
            incomplete += way is None
            if way is not None and (inside is None or not inside.isdisjoint(way.nodes)):
                ways.append(way)
    for relation in relations:
        for ring in _rings([by_id[number].nodes for number in relation.nodes if number in by_id]):
            way = _placed(_Line(-relation.id, relation.tags, ring), places)
            if way is not None and (inside is None or not inside.isdisjoint(way.nodes)):
                outlines.append(way)
    return OsmExtract(tuple(ways), tuple(outlines), tuple(tagged), incomplete)


def _relations(osmium: Any, path: Path) -> tuple[list[_Line], set[int]]:
    """Multipolygons that matter, with the ids of their outer ways in place of nodes."""
    found: list[_Line] = []
    members: set[int] = set()
    reader = osmium.FileProcessor(str(path), osmium.osm.RELATION).with_filter(
        osmium.filter.KeyFilter("building", "amenity")
    )
    for relation in reader:
        tags = dict(relation.tags)
        if tags.get("type") != "multipolygon" or not _matters(tags):
            continue
        outer = [member.ref for member in relation.members if member.type == "w" and member.role in ("outer", "")]
        found.append(_Line(relation.id, tags, outer))
        members.update(outer)
        _bound(len(members), MOST_WAYS, path)
    return found, members


def _lines(osmium: Any, path: Path, members: set[int]) -> tuple[list[_Line], set[int]]:
    """Ways that matter, and those that only bound a relation without tags; and the ids of all their nodes."""
    lines: list[_Line] = []
    needed: set[int] = set()
    seen: set[int] = set()
    filters = [osmium.filter.KeyFilter(*_WAY_KEYS)] + ([osmium.filter.IdFilter(members)] if members else [])
    for chosen in filters:
        for way in osmium.FileProcessor(str(path), osmium.osm.WAY).with_filter(chosen):
            if way.id in seen:
                continue
            tags = dict(way.tags)
            if not _matters(tags):
                if way.id not in members:
                    continue
                tags = {}
            seen.add(way.id)
            line = _Line(way.id, tags, [node.ref for node in way.nodes])
            lines.append(line)
            needed.update(line.nodes)
            _bound(len(lines), MOST_WAYS, path)
            _bound(len(needed), MOST_NODES, path)
    return lines, needed


def _places(
    osmium: Any, path: Path, needed: set[int], box: Box | None
) -> tuple[dict[int, tuple[float, float]], list[OsmNode]]:
    """Where the needed nodes lie, and the nodes with tags that matter."""
    places: dict[int, tuple[float, float]] = {}
    tagged: list[OsmNode] = []
    if needed:
        for node in osmium.FileProcessor(str(path), osmium.osm.NODE).with_filter(osmium.filter.IdFilter(needed)):
            if node.location.valid():
                places[node.id] = (node.location.lon, node.location.lat)
    for node in osmium.FileProcessor(str(path), osmium.osm.NODE).with_filter(osmium.filter.KeyFilter(*_NODE_KEYS)):
        if node.location.valid() and (box is None or _is_inside(node.location.lon, node.location.lat, box)):
            tagged.append(OsmNode(node.id, dict(node.tags), node.location.lon, node.location.lat))
            _bound(len(tagged), MOST_NODES, path)
    return places, tagged


def _matters(tags: Tags) -> bool:
    return "highway" in tags or "building" in tags or tags.get("amenity") in ("parking", "parking_space")


def _placed(line: _Line, places: dict[int, tuple[float, float]]) -> OsmWay | None:
    if len(line.nodes) < 2 or any(node not in places for node in line.nodes):
        return None
    return OsmWay(line.id, line.tags, tuple(line.nodes), np.array([places[node] for node in line.nodes]))


def _rings(lines: list[list[int]]) -> list[list[int]]:
    """Closed rings of node ids made by joining lines at their ends; what does not close is left out."""
    rings = [line for line in lines if len(line) >= 4 and line[0] == line[-1]]
    open_lines = [line for line in lines if len(line) >= 2 and line[0] != line[-1]]
    while open_lines:
        ring = list(open_lines.pop())
        while ring[0] != ring[-1]:
            at = next((i for i, line in enumerate(open_lines) if ring[-1] in (line[0], line[-1])), None)
            if at is None:
                break
            line = open_lines.pop(at)
            ring += line[1:] if line[0] == ring[-1] else line[-2::-1]
        if len(ring) >= 4 and ring[0] == ring[-1]:
            rings.append(ring)
    return rings


def _inside(places: dict[int, tuple[float, float]], box: Box) -> set[int]:
    return {node for node, (lon, lat) in places.items() if _is_inside(lon, lat, box)}


def _is_inside(lon: float, lat: float, box: Box) -> bool:
    west, south, east, north = box
    return west <= lon <= east and south <= lat <= north


def _bound(count: int, most: int, path: Path) -> None:
    if count > most:
        raise MapFileError(f"{path.name}: more than {most} objects: cut out the area with osmium extract")
