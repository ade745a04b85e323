"""Where operators draw, correct and erase spots while the service runs, and take the parking map with them."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from dataclasses import replace
from http import HTTPStatus
from typing import Annotated, Any

import numpy as np
import shapely
from fastapi import APIRouter, Depends, Path, Request, Response

from autowaze.cloud.api.bounding_box import BBOX, box_asked_for
from autowaze.cloud.api.changes import ChangeFeed
from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.ingest import bounded_body
from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.problems import ProblemError, problems
from autowaze.cloud.api.spot_book import SpotBook
from autowaze.cloud.api.spot_sheet import SpotSheet
from autowaze.cloud.api.spots import GEOJSON, SpotFeature, json_response
from autowaze.cloud.spot_edits import KINDS, SpotEdit, check_edit, drawing
from autowaze.cloud.store import AuditEntry, Store
from autowaze.cloud.store.tokens import Scope
from autowaze.world.drawn_spots import LONGEST_ID, document_of
from autowaze.world.parking import SpotState

MOST_BYTES = 1 << 16
"""Of a spot as GeoJSON; the largest that is any good has a thousand corners."""

_POSITION = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 3}
_RING = {"type": "array", "items": _POSITION, "minItems": 4, "maxItems": 1000}
_FEATURE: dict[str, Any] = {
    "type": "object",
    "required": ["type", "geometry"],
    "properties": {
        "type": {"const": "Feature"},
        "geometry": {
            "type": "object",
            "required": ["type", "coordinates"],
            "properties": {
                "type": {"const": "Polygon"},
                "coordinates": {"type": "array", "items": _RING, "minItems": 1, "maxItems": 1},
            },
        },
        "properties": {"type": ["object", "null"], "properties": {"kind": {"enum": list(KINDS)}}},
    },
}
_BODY: dict[str, Any] = {"requestBody": {"required": True, "content": {GEOJSON: {"schema": _FEATURE}}}}
_SpotId = Annotated[str, Path(min_length=1, max_length=LONGEST_ID)]
_REFUSALS = problems(
    HTTPStatus.BAD_REQUEST,
    HTTPStatus.UNAUTHORIZED,
    HTTPStatus.FORBIDDEN,
    HTTPStatus.CONFLICT,
    HTTPStatus.UNPROCESSABLE_ENTITY,
    HTTPStatus.SERVICE_UNAVAILABLE,
)


class ParkingEditor:
    """Makes one edit after the other: durable first, then in every feed at once, then announced.

    Args:
        told: is called in the event loop after each edit with the new sheet, the spot's id and its state, None if it
            was erased.
        clock: seconds since the epoch (UTC), for the audit log.
    """

    def __init__(
        self,
        intake: Intake,
        book: SpotBook,
        feed: ChangeFeed,
        store: Store,
        told: Callable[[SpotSheet, str, SpotState | None], None] | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._intake, self._book, self._feed, self._store = intake, book, feed, store
        self._told = told
        self._clock = clock
        self._editing = asyncio.Lock()

    async def make(self, edit: SpotEdit, actor: str) -> bool:
        """Make an edit; returns whether there was a spot of this id before. What it returns is durable.

        Raises:
            RefusedEditError: the spot cannot be so; nothing has changed.
            StoreError: it could not be kept; nothing has changed.
            ProblemError: 404 if the spot to erase is not there.
        """
        async with self._editing:
            before = self._book.sheet
            existed = edit.spot_id in before.row_of
            if edit.ring is None and not existed:
                raise ProblemError(HTTPStatus.NOT_FOUND, "not_found", f"there is no spot {edit.spot_id!r}")
            await self._intake.ask(lambda service: check_edit(edit, service.spots))
            # Worked out beside the intake's thread, so that diffs wait for no more than the edit itself.
            sheet = await asyncio.to_thread(_next_sheet, before, edit)
            version, state = await self._intake.edit(edit, actor, lambda: self._book.turn_to(sheet))
            if self._told is not None:
                self._told(sheet, edit.spot_id, state)
            self._feed.announce_parking_map(version)
            did = "spot erased" if edit.ring is None else "spot redrawn" if existed else "spot drawn"
            detail = f"{edit.spot_id}: parking map {version}"
            await asyncio.to_thread(self._store.audit, AuditEntry(0, self._clock(), actor, did, detail))
            return existed


def parking_editor_routes(editor: ParkingEditor, book: SpotBook, guard: Guard) -> APIRouter:
    """`/spots/{spot_id}` for operators, `/parking_map.geojson` for all."""
    router = APIRouter(tags=["parking map"])
    operator = Depends(guard.admits(Scope.OPERATOR))

    @router.put(
        "/spots/{spot_id}",
        openapi_extra=_BODY,
        responses={
            HTTPStatus.OK: {"model": SpotFeature, "content": {GEOJSON: {}}, "description": "Redrawn"},
            HTTPStatus.CREATED: {"model": SpotFeature, "content": {GEOJSON: {}}, "description": "Drawn"},
            **_REFUSALS,
            **problems(
                HTTPStatus.REQUEST_TIMEOUT,
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
                HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
            ),
        },
    )
    async def draw(request: Request, spot_id: _SpotId, actor: str = operator) -> Response:
        """Draw a spot, or another outline for one that there is: a GeoJSON Feature, a Polygon in lon, lat degrees.

        409 if it lies on other spots, 422 if no spot can look like it. The state of the others stays.
        """
        body = await bounded_body(request, MOST_BYTES, (GEOJSON, "application/json"), "a spot")
        try:
            feature = json.loads(body)
        except (ValueError, RecursionError):
            raise ProblemError(HTTPStatus.BAD_REQUEST, "bad_body", "this is not JSON") from None
        existed = await editor.make(drawing(spot_id, feature), actor)
        believed = await book.believed()
        row = believed.sheet.row_of.get(spot_id)
        if row is None:
            raise ProblemError(HTTPStatus.CONFLICT, "spot_clashes", "the spot was erased in the same moment")
        response = json_response(believed.feature(row), GEOJSON)
        response.status_code = HTTPStatus.OK if existed else HTTPStatus.CREATED
        return response

    @router.delete(
        "/spots/{spot_id}",
        status_code=HTTPStatus.NO_CONTENT,
        responses={**_REFUSALS, **problems(HTTPStatus.NOT_FOUND)},
    )
    async def erase(spot_id: _SpotId, actor: str = operator) -> Response:
        """Erase a spot; the last one stays."""
        await editor.make(SpotEdit(spot_id, None), actor)
        return Response(status_code=HTTPStatus.NO_CONTENT)

    @router.get("/parking_map.geojson", responses={200: {"content": {GEOJSON: {}}}, **problems(HTTPStatus.BAD_REQUEST)})
    async def parking_map(bbox: BBOX = None) -> Response:
        """The parking map as it is drawn now, as `autowaze cloud --spots` takes it; all, or what a box touches."""
        box = None if bbox is None else box_asked_for(bbox)
        return await asyncio.to_thread(_exported, book.sheet, box)

    return router


def _next_sheet(sheet: SpotSheet, edit: SpotEdit) -> SpotSheet:
    spot = edit.spot(sheet.georeference)
    return sheet.without_spot(edit.spot_id) if spot is None else sheet.with_spot(spot)


def _exported(sheet: SpotSheet, box: shapely.Geometry | None) -> Response:
    parking_map = sheet.parking_map
    if box is not None:
        rows = np.sort(sheet.tree.query(box, predicate="intersects"))
        parking_map = replace(parking_map, spots=tuple(parking_map.spots[row] for row in rows.tolist()))
    return json_response(document_of(parking_map.drawn), GEOJSON)
