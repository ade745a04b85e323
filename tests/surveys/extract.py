"""Small OpenStreetMap extracts, drawn in metres."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import osmium

from autowaze.world.georeference import Georeference

ORIGIN = Georeference(52.5, 13.4)


@dataclass
class Extract:
    """Ways and nodes in metres about the origin; nodes at the same place are one."""

    nodes: dict[tuple[float, float], int] = field(default_factory=dict)
    node_tags: dict[int, dict[str, str]] = field(default_factory=dict)
    ways: list[tuple[int, list[int], dict[str, str]]] = field(default_factory=list)
    relations: list[tuple[int, list[tuple[str, int, str]], dict[str, str]]] = field(default_factory=list)

    def node(self, x, y, **tags):
        number = self.nodes.setdefault((x, y), len(self.nodes) + 1)
        if tags:
            self.node_tags[number] = tags
        return number

    def way(self, points, tags=None, **more):
        number = len(self.ways) + 101
        self.ways.append((number, [self.node(x, y) for x, y in points], {**(tags or {}), **more}))
        return number

    def area(self, x, y, length, width, tags=None, **more):
        ring = [(x, y), (x + length, y), (x + length, y + width), (x, y + width), (x, y)]
        return self.way(ring, tags, **more)

    def write(self, path: Path) -> Path:
        with osmium.SimpleWriter(str(path)) as writer:
            for (x, y), number in self.nodes.items():
                lon, lat = ORIGIN.to_lon_lat(np.array([[x, y]]))[0]
                tags = self.node_tags.get(number, {})
                writer.add_node(osmium.osm.mutable.Node(id=number, location=(lon, lat), tags=tags, version=1))
            for number, nodes, tags in self.ways:
                writer.add_way(osmium.osm.mutable.Way(id=number, nodes=nodes, tags=tags, version=1))
            for number, members, tags in self.relations:
                writer.add_relation(osmium.osm.mutable.Relation(id=number, members=members, tags=tags, version=1))
        return path
