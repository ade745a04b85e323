"""The map for cars: whole, or what they lack since a version, of everything or of the tiles around them."""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from http import HTTPStatus
from typing import Annotated

import numpy as np
import shapely
from fastapi import APIRouter, Header, Path, Query, Response
from numpy.typing import NDArray
from pydantic import BaseModel

from autowaze.cloud.api.bounding_box import BBOX, box_asked_for
from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.problems import ProblemError, problems
from autowaze.cloud.service import CloudService
from autowaze.world.tiles import TILE_ZOOM, TILES_ACROSS, Tile, tile_bounds, tiles_of
from autowaze.world.wire import encode_map, encode_map_update

_BYTES = {"content": {"application/octet-stream": {}}, "description": "docs/wire-format.md"}

MOST_TILES = 4096
_Column = Annotated[int, Path(ge=0, lt=TILES_ACROSS)]


class TileVersion(BaseModel):
    """One tile of web mercator, zoom 17.

    Attributes:
        map_version: of the map when features of the tile came or went last; null if it never had any.
        spots_version: of the map when spots of the tile changed last; null if it has none.
    """

    x: int
    y: int
    map_version: int | None
    spots_version: int | None


class TileVersions(BaseModel):
    """The tiles that have features or spots.

    Attributes:
        version: of the map.
    """

    version: int
    zoom: int = TILE_ZOOM
    tiles: list[TileVersion]


class PackedMap:
    """The whole map as bytes, packed once per version however many cars ask."""

    def __init__(self, intake: Intake) -> None:
        self._intake = intake
        self._packing = asyncio.Lock()
        self._version = -1
        self._data = b""

    async def current(self) -> tuple[int, bytes]:
        """Version and bytes."""
        async with self._packing:
            if self._version != await self._intake.ask(lambda service: service.map.version):
                feature_map = await self._intake.ask(lambda service: service.feature_map)
                self._data = await asyncio.to_thread(encode_map, feature_map)
                self._version = feature_map.version
            return self._version, self._data


def map_routes(intake: Intake) -> APIRouter:
    """`/map`, `/map/updates` and `/map/tiles`."""
    router = APIRouter(tags=["map"])
    packed = PackedMap(intake)

    @router.get("/map", response_class=Response, responses={200: _BYTES, 304: {"description": "Not modified"}})
    async def whole_map(if_none_match: Annotated[str | None, Header(max_length=200)] = None) -> Response:
        """The stored map, a map file."""
        version, data = await packed.current()
        headers = {"ETag": f'"{version}"', "Autowaze-Map-Version": str(version)}
        if if_none_match == headers["ETag"]:
            return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=headers)
        return Response(data, media_type="application/octet-stream", headers=headers)

    @router.get(
        "/map/updates",
        response_class=Response,
        responses={200: _BYTES, **problems(HTTPStatus.BAD_REQUEST, HTTPStatus.GONE)},
    )
    async def updates(since: Annotated[int, Query(ge=0, lt=1 << 63)]) -> Response:
        """The map update from a version to the newest; 410 if the map must be fetched whole."""
        update = await intake.ask(lambda service: service.map_update_since(since))
        data = await asyncio.to_thread(encode_map_update, update)
        headers = {"Autowaze-Map-Version": str(update.to_version)}
        return Response(data, media_type="application/octet-stream", headers=headers)

    @router.get("/map/tiles", responses=problems(HTTPStatus.BAD_REQUEST))
    async def tiles(bbox: BBOX = None) -> TileVersions:
        """Which tiles changed last with which version."""
        box = box_asked_for(bbox) if bbox is not None else None
        found = await intake.ask(lambda service: _tile_versions(service, box))
        if len(found.tiles) > MOST_TILES:
            raise ProblemError(HTTPStatus.BAD_REQUEST, "bad_parameter", f"bbox: more than {MOST_TILES} tiles lie in it")
        return found

    @router.get(
        f"/map/tiles/{TILE_ZOOM}/{{x}}/{{y}}",
        response_class=Response,
        responses={
            200: _BYTES,
            304: {"description": "Not modified"},
            **problems(HTTPStatus.BAD_REQUEST, HTTPStatus.GONE),
        },
    )
    async def tile_update(
        x: _Column,
        y: _Column,
        since: Annotated[
            int | None, Query(ge=0, lt=1 << 63, description="Version of the tile that the car has.")
        ] = None,
        if_none_match: Annotated[str | None, Header(max_length=200)] = None,
    ) -> Response:
        """The map update of one tile: since a version, or without one all that lies in it; 410 if that is needed."""
        tile = Tile(x, y)
        version = await intake.ask(lambda service: service.map.tiles.version(tile))
        etag = f'"{version}"'
        if if_none_match == etag:
            return Response(status_code=HTTPStatus.NOT_MODIFIED, headers={"ETag": etag})
        update = await intake.ask(lambda service: service.map.tile_update(tile, since))
        data = await asyncio.to_thread(encode_map_update, update)
        headers = {"ETag": etag, "Autowaze-Map-Version": str(update.to_version)}
        return Response(data, media_type="application/octet-stream", headers=headers)

    return router


def _tile_versions(service: CloudService, box: shapely.Geometry | None) -> TileVersions:
    records, spots = service.map.tiles.records, service.spot_tiles.versions
    tiles = sorted({*records, *spots} if box is None else _known_around(box, records, spots))
    if box is not None:
        bounds = np.array([tile_bounds(tile) for tile in tiles]).reshape(-1, 4).T
        inside: NDArray[np.bool_] = np.asarray(shapely.intersects(box, shapely.box(*bounds)))
        tiles = [tile for tile, is_inside in zip(tiles, inside.tolist(), strict=True) if is_inside]
    return TileVersions(
        version=service.map.version,
        tiles=[
            TileVersion(
                x=tile.x,
                y=tile.y,
                map_version=records[tile].version if tile in records else None,
                spots_version=spots.get(tile),
            )
            for tile in tiles[: MOST_TILES + 1]
        ],
    )


def _known_around(box: shapely.Geometry, *known: Collection[Tile]) -> set[Tile]:
    """Those of the known tiles that may meet a box in lon/lat: no more work than the box or the city has tiles."""
    found: set[Tile] = set()
    for part in shapely.get_parts(box):
        west, south, east, north = shapely.bounds(part).tolist()
        (x0, y0), (x1, y1) = tiles_of(np.array([[west, north], [east, south]])).tolist()
        columns, rows = range(x0 - 1, x1 + 2), range(y0 - 1, y1 + 2)  # who only touches the box meets it, too
        for tiles in known:
            if len(columns) * len(rows) < len(tiles):
                found.update(tile for x in columns for y in rows if (tile := Tile(x, y)) in tiles)
            else:
                found.update(tile for tile in tiles if tile.x in columns and tile.y in rows)
    return found
