"""What the live map shows besides the spots: streets, buildings, areas, trees."""

from __future__ import annotations

import asyncio
import gzip
import hashlib
import json
from collections.abc import Iterable
from http import HTTPStatus
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from fastapi import APIRouter, Header, Response
from pydantic import BaseModel, Field

from autowaze.cloud.api.bounding_box import BBOX, box_asked_for
from autowaze.cloud.api.problems import ProblemError, problems
from autowaze.cloud.api.spots import GEOJSON
from autowaze.world.streets import StreetNetwork


class StreetProperties(BaseModel):
    """What a feature is; the members of other kinds are missing."""

    kind: Literal["street", "building", "area", "tree"]
    name: str | None = Field(None, description="Of a street.")
    oneway: bool | None = Field(None, description="Of a street, for who drives: in the direction of the line.")
    speed_kmh: float | None = None
    width_m: float | None = None
    walking: bool | None = Field(None, description="False for a street without pavement; true where it is missing.")
    driving: bool | None = Field(None, description="False for a footway; true where it is missing.")
    height_m: float | None = Field(None, description="Of a building.")
    surface: str | None = Field(None, description="Of an area.")
    radius_m: float | None = Field(None, description="Of a tree's crown.")


class StreetFeature(BaseModel):
    """A street, building, area or tree (RFC 7946), lon/lat."""

    type: Literal["Feature"]
    geometry: dict[str, Any]
    properties: StreetProperties


class StreetCollection(BaseModel):
    """What lies around the spots."""

    type: Literal["FeatureCollection"]
    features: list[StreetFeature]


class StreetSheet:
    """The street network as text, worked out once."""

    def __init__(self, network: StreetNetwork) -> None:
        self._tree = shapely.STRtree(network.geometries())
        self._features = [json.dumps(feature, separators=(",", ":")) for feature in network.features()]
        self.whole = _collection(self._features)
        self.whole_packed = gzip.compress(self.whole, compresslevel=6, mtime=0)
        self.tag = f'"{hashlib.sha256(self.whole).hexdigest()[:16]}"'

    def within(self, box: shapely.Geometry) -> bytes:
        """What a box (lon/lat) touches."""
        return _collection(self._features[row] for row in np.sort(self._tree.query(box, predicate="intersects")))


def street_routes(network: StreetNetwork | None) -> APIRouter:
    """`/streets.geojson`; answers 404 where the service knows no streets."""
    router = APIRouter(tags=["map"])
    sheet = StreetSheet(network) if network is not None else None

    @router.get(
        "/streets.geojson",
        responses={
            200: {"model": StreetCollection, "content": {GEOJSON: {}}},
            304: {"description": "Not modified"},
            **problems(HTTPStatus.BAD_REQUEST, HTTPStatus.NOT_FOUND),
        },
    )
    async def streets(
        bbox: BBOX = None,
        if_none_match: Annotated[str | None, Header(max_length=200)] = None,
        accept_encoding: Annotated[str, Header(max_length=1000)] = "",
    ) -> Response:
        """Streets, buildings, areas and trees: all, or those that a box touches."""
        if sheet is None:
            raise ProblemError(HTTPStatus.NOT_FOUND, "not_found", "this service knows no streets")
        headers = {"ETag": sheet.tag, "Cache-Control": "public, max-age=300", "Vary": "Accept-Encoding"}
        if if_none_match == sheet.tag:
            return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=headers)
        if bbox is not None:
            body = await asyncio.to_thread(sheet.within, box_asked_for(bbox))
        elif "gzip" in accept_encoding:
            body, headers["Content-Encoding"] = sheet.whole_packed, "gzip"
        else:
            body = sheet.whole
        return Response(body, media_type=GEOJSON, headers=headers)

    return router


def _collection(features: Iterable[str]) -> bytes:
    return f'{{"type":"FeatureCollection","features":[{",".join(features)}]}}'.encode()
