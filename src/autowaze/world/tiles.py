"""Web-mercator tiles of zoom 17, some 300 m wide in mid-latitudes: the partition of maps and spots by place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autowaze.world.georeference import Georeference

TILE_ZOOM = 17
TILES_ACROSS = 1 << TILE_ZOOM
_MOST_LATITUDE_DEG = 85.05112877980659  # where web mercator ends: the world is a square


class Tile(NamedTuple):
    """Column, counted from 180 degrees west, and row, counted from the north."""

    x: int
    y: int


def tiles_of(lon_lat: NDArray[np.floating]) -> NDArray[np.int64]:
    """Tiles x, y (N, 2) of points (N, 2) in lon, lat degrees (WGS84); beyond the map's edge those of the edge."""
    lon_lat = np.asarray(lon_lat, dtype=np.float64).reshape(-1, 2)
    latitude = np.radians(np.clip(lon_lat[:, 1], -_MOST_LATITUDE_DEG, _MOST_LATITUDE_DEG))
    x = (lon_lat[:, 0] + 180.0) / 360.0
    y = (1.0 - np.arcsinh(np.tan(latitude)) / np.pi) / 2.0
    cells = np.floor(np.column_stack([x, y]) * TILES_ACROSS).astype(np.int64)
    return np.clip(cells, 0, TILES_ACROSS - 1)


def tiles_of_map(points_map: NDArray[np.floating], georeference: Georeference) -> NDArray[np.int64]:
    """Tiles x, y (N, 2) of points (N, 2) or (N, 3) in map metres."""
    points = np.asarray(points_map, dtype=np.float64)
    return tiles_of(georeference.to_lon_lat(points)) if len(points) else np.zeros((0, 2), np.int64)


def tiles_around(
    position_map: NDArray[np.floating], radius_m: float, georeference: Georeference, most: int = 64
) -> list[Tile]:
    """The tiles that a square of twice the radius around a map position touches, nearest first, at most so many."""
    steps = np.linspace(-radius_m, radius_m, 2 + int(radius_m / 50.0))  # no tile is narrower where people drive
    east, north = (a.ravel() for a in np.meshgrid(steps, steps))
    order = np.argsort(east**2 + north**2, kind="stable")
    centre = np.asarray(position_map, dtype=np.float64)[:2]
    square = centre + np.column_stack([east, north])[order]
    near = tiles_of_map(square, georeference)
    return list(dict.fromkeys(Tile(int(x), int(y)) for x, y in near))[:most]


def tile_bounds(tile: Tile) -> tuple[float, float, float, float]:
    """West, south, east, north in degrees."""
    edges = np.array([tile.y + 1, tile.y]) / TILES_ACROSS
    south, north = np.degrees(np.arctan(np.sinh(np.pi * (1.0 - 2.0 * edges)))).tolist()
    west, east = (np.array([tile.x, tile.x + 1]) / TILES_ACROSS * 360.0 - 180.0).tolist()
    return west, south, east, north
