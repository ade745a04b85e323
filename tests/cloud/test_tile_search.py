"""Which tiles a client is told of that asks for a box."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from autowaze.cloud.api.bounding_box import box_asked_for
from autowaze.cloud.api.feature_map import _tile_versions
from autowaze.world.tiles import Tile, tile_bounds, tiles_of


def _service(records: dict, spots: dict) -> SimpleNamespace:
    versions = SimpleNamespace(records={tile: SimpleNamespace(version=v) for tile, v in records.items()})
    return SimpleNamespace(map=SimpleNamespace(version=9, tiles=versions), spot_tiles=SimpleNamespace(versions=spots))


@pytest.mark.parametrize("size_deg", [0.0005, 0.01, 0.2, 30.0])
def test_tiles_in_a_box_are_those_that_meet_it(size_deg: float) -> None:
    rng = np.random.default_rng(0)
    x, y = tiles_of(np.array([[-73.0, 40.0]]))[0].tolist()
    every = [Tile(x + i, y + j) for i, j in rng.integers(-20, 20, (400, 2)).tolist()]
    edge = [Tile(0, y), Tile((1 << 17) - 1, y)]
    service = _service(dict.fromkeys([*every[:250], *edge], 3), dict.fromkeys(every[200:], 5))
    boxes = [
        f"{w},{s},{w + size_deg},{s + size_deg}" for w, s in rng.uniform([-73.06, 39.96], [-72.96, 40.04], (20, 2))
    ]
    boxes += [f"{179.999 - size_deg},39.9,{-179.999 + size_deg},40.1", "-360,-90,360,90"]
    west, south, east, north = tile_bounds(every[0])
    boxes.append(f"{west},{south},{east},{north}")
    for text in boxes:
        box = box_asked_for(text)
        expected = [t for t in sorted({*every, *edge}) if shapely.intersects(box, shapely.box(*tile_bounds(t)))]
        found = _tile_versions(service, box).tiles
        assert [(t.x, t.y) for t in found] == expected
        assert [t.map_version for t in found] == [3 if t in {*every[:250], *edge} else None for t in expected]
