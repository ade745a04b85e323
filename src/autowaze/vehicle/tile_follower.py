"""The map around the car, brought up to date tile by tile; nothing that a service says is believed unchecked."""

from __future__ import annotations

import json
from dataclasses import dataclass
from http import HTTPStatus

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.connection import CloudConnection, Reply
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.map_update import MapUpdate
from autowaze.world.tiles import TILE_ZOOM, Tile, tile_bounds, tiles_around, tiles_of, tiles_of_map
from autowaze.world.wire import decode_map_update

FETCHED_AROUND_M, KEPT_AROUND_M = 250.0, 600.0
MOST_TILES, MOST_KEPT_TILES = 36, 121
MOST_FEATURES = 1 << 18
"""Held at once, 40 MiB; where the map is denser than this the farthest tiles wait."""
MOST_TILE_FEATURES, MOST_TILE_BYTES = 1 << 17, 16 << 20
MOST_LISTING_BYTES = 1 << 20
_EDGE_DEG = 2e-5  # positions are rounded to a centimetre on their way, so some fall over the edge of their tile


class BadMapError(AutowazeError):
    """The service's map cannot be what it says it is; the car goes on with what it has."""


@dataclass(frozen=True)
class _Listing:
    version: int
    tiles: dict[Tile, int]


class TileFollower:
    """Knows which tiles a car has, and as of which version; fetches those that it lacks.

    Args:
        connection: to the service; used by `follow` only.
        georeference: of the car's map frame; a map in another one is refused.
        stored_map: what the car has to begin with. What the service has of a tile takes its place.

    Attributes:
        version: of the map that the last returned update led to.
    """

    def __init__(
        self, connection: CloudConnection, georeference: Georeference, stored_map: FeatureMap | None = None
    ) -> None:
        features = MapFeatures.empty() if stored_map is None else stored_map.features
        self.version = 0 if stored_map is None else stored_map.version
        self._connection = connection
        self._georeference = georeference
        self._versions: dict[Tile, int | None] = {}  # None: held, but of another history of the map
        self._id = features.id
        self._tile = tiles_of_map(features.position, georeference)

    def follow(self, position_map: NDArray[np.floating]) -> MapUpdate | None:
        """What the car's map lacks around a map position and what it may forget far from it; None if nothing.

        The update is whole: once it is returned, the next one starts from it.

        Raises:
            UnreachableError: the service does not answer.
            AutowazeError: it does not give its map away, or what it gives cannot be true. Nothing has changed.
        """
        wanted = tiles_around(position_map, FETCHED_AROUND_M, self._georeference, MOST_TILES)
        listing = self._listing(wanted)
        versions = dict(self._versions)
        if listing.version < max((v for v in versions.values() if v is not None), default=0):
            versions = dict.fromkeys(versions)
        kept = set(tiles_around(position_map, KEPT_AROUND_M, self._georeference, MOST_KEPT_TILES)) | set(wanted)
        far = [tile for tile in versions if tile not in kept]
        removed = [self._ids_in(tile) for tile in far]
        added, homes = [MapFeatures.empty()], [np.zeros((0, 2), np.int64)]
        versions = {tile: version for tile, version in versions.items() if tile in kept}
        room = MOST_FEATURES - len(self._id)
        for tile in wanted:
            since = versions.get(tile)
            if since is not None and listing.tiles.get(tile, 0) <= since:
                continue
            update, is_whole = self._tile_update(tile, since)
            room += len(update.removed) - len(update.added)
            if room < 0:
                break
            held = self._ids_in(tile)
            gone = np.setdiff1d(held, update.added.id) if is_whole else np.intersect1d(held, update.removed)
            news = update.added[~np.isin(update.added.id, held)]
            versions[tile] = update.to_version
            removed.append(gone)
            added.append(news)
            homes.append(np.tile(np.array(tile, np.int64), (len(news), 1)))
        return self._adopted(versions, listing.version, MapFeatures.concatenate(added), np.vstack(homes), removed)

    def _adopted(
        self,
        versions: dict[Tile, int | None],
        version: int,
        added: MapFeatures,
        homes: NDArray[np.int64],
        removed: list[NDArray[np.uint64]],
    ) -> MapUpdate | None:
        gone = np.unique(np.concatenate([np.zeros(0, np.uint64), *removed]))
        lasting = ~np.isin(self._id, gone)
        ids = np.concatenate([self._id[lasting], added.id])
        if len(np.unique(ids)) < len(ids):
            raise BadMapError(f"{self._connection.url}: one feature lies in two tiles")
        self._versions = versions
        self._id, self._tile = ids, np.vstack([self._tile[lasting], homes])
        if not len(gone) and not len(added):
            return None
        update = MapUpdate(self.version, version, added, gone, self._georeference)
        self.version = version
        return update

    def _ids_in(self, tile: Tile) -> NDArray[np.uint64]:
        inside = (self._tile[:, 0] == tile.x) & (self._tile[:, 1] == tile.y)
        return np.asarray(self._id[inside], dtype=np.uint64)

    def _listing(self, wanted: list[Tile]) -> _Listing:
        """Version of the map, and that with which each wanted tile changed last."""
        bounds = np.array([tile_bounds(tile) for tile in wanted])
        (west, south), (east, north) = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
        reply = self._connection.get(f"/map/tiles?bbox={west},{south},{east},{north}", MOST_LISTING_BYTES)
        expect_ok(reply, f"{self._connection.url}/map/tiles")
        try:
            document = json.loads(reply.body)
            tiles = {Tile(t["x"], t["y"]): t["map_version"] or 0 for t in document["tiles"]}
            version = document["version"]
            if any(type(n) is not int or not 0 <= n < 1 << 63 for n in (version, *tiles.values())):
                raise ValueError("not a version")
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise BadMapError(f"{self._connection.url}/map/tiles: not a list of tiles: {error}") from error
        return _Listing(version, {tile: tiles[tile] for tile in wanted if tile in tiles})

    def _tile_update(self, tile: Tile, since: int | None) -> tuple[MapUpdate, bool]:
        """What came and went in a tile, or all of it where that is needed; and whether it is all."""
        update = fetch_tile(self._connection, tile, since)
        if update is None:
            since, update = None, fetch_tile(self._connection, tile, None)
        if update is None or update.georeference != self._georeference:
            raise BadMapError(f"{self._connection.url}: its map has another map frame than this drive")
        return update, since is None


def fetch_tile(connection: CloudConnection, tile: Tile, since: int | None) -> MapUpdate | None:
    """The map update of one tile, checked; None if it must be fetched whole. Raises as `TileFollower.follow` does."""
    path = f"/map/tiles/{TILE_ZOOM}/{tile.x}/{tile.y}"
    reply = connection.get(path if since is None else f"{path}?since={since}", MOST_TILE_BYTES)
    if reply.status == HTTPStatus.GONE and since is not None:
        return None
    address = f"{connection.url}{path}"
    expect_ok(reply, address)
    update = decode_map_update(reply.body, MOST_TILE_BYTES, MOST_TILE_FEATURES)
    if update.from_version != (since or 0):
        raise BadMapError(f"{address}: an update from version {update.from_version}, asked for {since or 0}")
    if update.georeference is None:
        raise BadMapError(f"{address}: does not say in which map frame it is")
    if len(update.added):
        lon_lat = update.georeference.to_lon_lat(update.added.position)
        west, south, east, north = tile_bounds(tile)
        if (
            (lon_lat < [west - _EDGE_DEG, south - _EDGE_DEG]) | (lon_lat > [east + _EDGE_DEG, north + _EDGE_DEG])
        ).any():
            raise BadMapError(f"{address}: has features that lie elsewhere")
    return update


def map_frame_at(connection: CloudConnection, lon_deg: float, lat_deg: float) -> Georeference:
    """The map frame of the service's map at a place; raises as `TileFollower.follow` does."""
    x, y = tiles_of(np.array([[lon_deg, lat_deg]]))[0].tolist()
    update = fetch_tile(connection, Tile(x, y), None)
    if update is None or update.georeference is None:
        raise BadMapError(f"{connection.url}: does not say in which map frame it is")
    return update.georeference


def expect_ok(reply: Reply, address: str) -> None:
    """Raise `AutowazeError` unless the service answered 200."""
    if reply.status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
        raise AutowazeError(f"{address}: needs a token with scope map; make one with: autowaze cloud token add NAME")
    if reply.status != HTTPStatus.OK:
        raise AutowazeError(f"{address}: the service answered {reply.status}")
