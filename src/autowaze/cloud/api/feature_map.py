"""The map for cars: whole, or what they lack since a version."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Header, Query, Response

from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.problems import problems
from autowaze.world.wire import encode_map, encode_map_update

_BYTES = {"content": {"application/octet-stream": {}}, "description": "docs/wire-format.md"}


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
    """`/map` and `/map/updates`."""
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

    return router
