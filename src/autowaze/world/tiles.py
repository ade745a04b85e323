"""Web-mercator tiles of zoom 17, some 300 m wide in mid-latitudes: the partition of maps and spots by place."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from autowaze.world.georeference import Georeference

TILE_ZOOM = 17
TILES_ACROSS = 1 << TILE_ZOOM
WGS84_A_M, WGS84_E2 = 6_378_137.0, 6.694_379_990_141_316e-3
"""Equatorial radius and squared eccentricity."""
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
    points = np.ascontiguousarray(points_map, dtype=np.float64)
    cells: NDArray[np.int64] = _tiles_of_plane(points, *_plane(georeference))
    return cells


@lru_cache(maxsize=64)
def _plane(georeference: Georeference) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Origin (3,) and axes (3, 3), columns east, north, up, of a tangent plane in earth-centred metres."""
    lat, lon = np.radians([georeference.lat_deg, georeference.lon_deg])
    (sin_lat, sin_lon), (cos_lat, cos_lon) = np.sin([lat, lon]), np.cos([lat, lon])
    normal_m = WGS84_A_M / np.sqrt(1.0 - WGS84_E2 * sin_lat**2)
    up = np.array([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat])
    east = np.array([-sin_lon, cos_lon, 0.0])
    origin = (normal_m + georeference.altitude_m) * up - [0.0, 0.0, WGS84_E2 * normal_m * sin_lat]
    return origin, np.ascontiguousarray(np.stack([east, np.cross(up, east), up], axis=1))


@njit(cache=True, nogil=True)
def _tiles_of_plane(points, origin, axes):  # type: ignore[no-untyped-def]
    """Tiles x, y (N, 2) of points (N, 2) or (N, 3); the latitude by Bowring (1976), exact to a micrometre near ground.

    The same as `tiles_of(georeference.to_lon_lat(points))`, for the hundreds of features of each diff.
    """
    most = math.radians(_MOST_LATITUDE_DEG)
    b = WGS84_A_M * math.sqrt(1.0 - WGS84_E2)
    second_e2 = WGS84_E2 / (1.0 - WGS84_E2)
    cells = np.empty((len(points), 2), np.int64)
    for row in range(len(points)):
        east, north = points[row, 0], points[row, 1]
        up = points[row, 2] if points.shape[1] > 2 else 0.0
        x = origin[0] + axes[0, 0] * east + axes[0, 1] * north + axes[0, 2] * up
        y = origin[1] + axes[1, 0] * east + axes[1, 1] * north + axes[1, 2] * up
        z = origin[2] + axes[2, 0] * east + axes[2, 1] * north + axes[2, 2] * up
        p = math.hypot(x, y)
        theta = math.atan2(z * WGS84_A_M, p * b)
        lat = math.atan2(z + second_e2 * b * math.sin(theta) ** 3, p - WGS84_E2 * WGS84_A_M * math.cos(theta) ** 3)
        lat = min(max(lat, -most), most)
        across = (math.atan2(y, x) / math.pi + 1.0) / 2.0
        down = (1.0 - math.asinh(math.tan(lat)) / math.pi) / 2.0
        cells[row, 0] = min(max(math.floor(across * TILES_ACROSS), 0), TILES_ACROSS - 1)
        cells[row, 1] = min(max(math.floor(down * TILES_ACROSS), 0), TILES_ACROSS - 1)
    return cells


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
