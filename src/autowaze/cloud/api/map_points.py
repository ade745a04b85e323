"""The feature map as points, for the live map."""

from __future__ import annotations

import asyncio
import json
from http import HTTPStatus
from typing import Annotated

import numpy as np
import shapely
from fastapi import APIRouter, Query, Response
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from autowaze.cloud.api.bounding_box import box_asked_for
from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.problems import problems
from autowaze.cloud.service import CloudService
from autowaze.cloud.thinning import share_of, thinned_evenly
from autowaze.world.feature_map import MapFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.tiles import Tile, tiles_of

MOST_POINTS = 200_000
MOST_LOOKED_AT = 2_000_000
"""Features that are thinned one against the other; of more a share is taken beforehand."""
_WORLD_DEG = 85.0
"""Where tiles of the web-mercator projection end."""


class Origin(BaseModel):
    """Where the points' frame lies: WGS84 degrees, metres above the ellipsoid."""

    lon: float
    lat: float
    altitude_m: float


class MapPoints(BaseModel):
    """Features as columns: metres east, north and up of the origin, and what each lies on."""

    count: int = Field(description="Of the columns' entries.")
    total: int = Field(description="Features in the box.")
    map_version: int
    origin: Origin
    x: list[float]
    y: list[float]
    z: list[float]
    label: list[int] = Field(description="0 background, 1 car, 2 truck, 3 bus, 4 two-wheeler, 5 person, …")


def map_point_routes(intake: Intake, georeference: Georeference) -> APIRouter:
    """`/map/points`."""
    router = APIRouter(tags=["map"])
    thinning = asyncio.Lock()

    @router.get("/map/points", responses={200: {"model": MapPoints}, **problems(HTTPStatus.BAD_REQUEST)})
    async def points(
        bbox: Annotated[str, Query(max_length=200, description="west,south,east,north in degrees")],
        limit: Annotated[int, Query(ge=1, le=MOST_POINTS)] = 50_000,
    ) -> Response:
        """Features of the map in a box, thinned evenly where there are too many: the same ones every time."""
        box = box_asked_for(bbox)
        version, blocks = await intake.ask(lambda service: (service.map.version, _blocks_near(service, box)))
        async with thinning:
            body = await asyncio.to_thread(_written, blocks, box, limit, georeference, version)
        return Response(body, media_type="application/json", headers={"Cache-Control": "no-cache"})

    return router


def _blocks_near(service: CloudService, box: shapely.Geometry) -> list[MapFeatures]:
    """Blocks with features in the tiles that the box touches; they are never written to again."""
    blocks: dict[int, MapFeatures] = {}
    for part in shapely.get_parts(box):
        west, south, east, north = part.bounds
        if north < -_WORLD_DEG or south > _WORLD_DEG:
            continue
        low, high = (Tile(*tile) for tile in tiles_of(np.array([[west, north], [east, south]])).tolist())
        blocks |= service.map.blocks_in(low, high)
    return list(blocks.values())


def _written(
    blocks: list[MapFeatures], box: shapely.Geometry, limit: int, georeference: Georeference, version: int
) -> bytes:
    outline = _on_map(box, georeference)
    share = MOST_LOOKED_AT / max(sum(map(len, blocks)), 1)
    position, ids, label, total = [np.zeros((0, 3))], [np.zeros(0, np.uint64)], [np.zeros(0, np.uint8)], 0
    for block in blocks:
        inside = shapely.contains_xy(outline, block.position[:, 0], block.position[:, 1])
        total += int(inside.sum())
        inside &= share_of(block.id, share)
        position.append(block.position[inside])
        ids.append(block.id[inside])
        label.append(block.label[inside])
    points, labels = np.concatenate(position), np.concatenate(label)
    rows = thinned_evenly(points, np.concatenate(ids), limit)
    x, y, z = np.round(points[rows], 2).T
    origin = {"lon": georeference.lon_deg, "lat": georeference.lat_deg, "altitude_m": georeference.altitude_m}
    columns = {"x": x.tolist(), "y": y.tolist(), "z": z.tolist(), "label": labels[rows].tolist()}
    document = {"count": len(rows), "total": total, "map_version": version, "origin": origin, **columns}
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


def _on_map(box: shapely.Geometry, georeference: Georeference) -> shapely.Geometry:
    """The box in map metres; its long sides bend there, so they get more corners."""

    def to_map(lon_lat: NDArray[np.float64]) -> NDArray[np.float64]:
        return georeference.to_map(lon_lat)[:, :2]

    outline = shapely.transform(shapely.segmentize(box, 0.25), to_map)
    shapely.prepare(outline)
    return outline
