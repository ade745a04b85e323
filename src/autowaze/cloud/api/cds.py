"""The Curb Data Specification 1.1 under `/cds`: curbs and events, as far as cars that drive by can tell."""

from __future__ import annotations

import json
import re
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Query, Request, Response

from autowaze.cloud.api.cds_area import Area, area_asked_for
from autowaze.cloud.api.cds_events import Events
from autowaze.cloud.api.problems import ProblemError, problems
from autowaze.cloud.api.spot_book import BelievedSpots, SpotBook
from autowaze.cloud.api.zones import Zone
from autowaze.world.parking import Occupancy

MEDIA_TYPE = "application/vnd.cds+json;version=1.1"
VERSION = "1.1.0"
MOST_AT_ONCE = 1000
_NOT_HERE = {
    "curbs/areas": "areas are drawn by the agency",
    "curbs/policies": "policies are made by the agency",
    "events/status": "cars are no installed devices",
    "metrics/sessions": "who drives by sees no sessions",
    "metrics/aggregates": "who drives by sees no sessions",
}
_Degrees = float | None
_TEXT = Annotated[str | None, Query(max_length=100)]


def cds_routes(book: SpotBook, events: Events, surveyed_at: float, author: str = "Autowaze") -> APIRouter:
    """Curbs and events; `surveyed_at` is when the spots were drawn, seconds since the epoch."""
    router = APIRouter(prefix="/cds", tags=["CDS"], dependencies=[Depends(_check_version)])
    surveyed_ms = round(1000 * surveyed_at)

    def area(
        min_lat: _Degrees = None,
        min_lng: _Degrees = None,
        max_lat: _Degrees = None,
        max_lng: _Degrees = None,
        lat: _Degrees = None,
        lng: _Degrees = None,
        radius: Annotated[int | None, Query(ge=0, le=10**9, description="Centimetres.")] = None,
    ) -> Area:
        return area_asked_for(book.sheet.georeference, (min_lng, min_lat, max_lng, max_lat), (lng, lat), radius)

    in_area = Depends(area)
    ok: dict[int | str, dict[str, Any]] = {200: {"content": {MEDIA_TYPE: {}}}}
    responses = {**ok, **problems(HTTPStatus.BAD_REQUEST, HTTPStatus.NOT_ACCEPTABLE)}

    def answer(data: dict[str, Any], believed: BelievedSpots, following: str | None = None) -> Response:
        envelope = {
            "version": VERSION,
            "time_zone": "UTC",
            "last_updated": round(1000 * believed.now),
            "currency": None,
            "author": author,
            "license_url": None,
            "data": data,
            "links": {"next": following},
        }
        body = json.dumps(envelope, separators=(",", ":"), allow_nan=False)
        return Response(body, media_type=MEDIA_TYPE, headers={"Cache-Control": "no-cache"})

    @router.get("/curbs/zones", responses=responses)
    async def zones(
        request: Request,
        where: Area = in_area,
        time: Annotated[int | None, Query(description="Milliseconds: zones in force then.")] = None,
        offset: Annotated[int, Query(ge=0, lt=1 << 31)] = 0,
    ) -> Response:
        """Stretches of kerb with how many of their spaces are free."""
        believed = await book.believed()
        kerb = believed.sheet.kerb
        chosen = where.chosen([(zone, zone.polygon) for zone in kerb.zones] if _in_force(time, surveyed_ms) else [])
        shown = [_zone(zone, believed, surveyed_ms) for zone in chosen[offset : offset + MOST_AT_ONCE]]
        return answer({"zones": shown}, believed, _next(request, offset, len(chosen)))

    @router.get("/curbs/zones/{zone_id}", responses={**responses, **problems(HTTPStatus.NOT_FOUND)})
    async def zone(zone_id: str) -> Response:
        """One zone."""
        believed = await book.believed()
        found = _found(believed.sheet.kerb.zone_by_id.get(zone_id), "zone")
        return answer({"zone": _zone(found, believed, surveyed_ms)}, believed)

    @router.get("/curbs/spaces", responses=responses)
    async def spaces(
        request: Request,
        where: Area = in_area,
        curb_zone_id: _TEXT = None,
        time: Annotated[int | None, Query(description="Milliseconds: spaces in force then.")] = None,
        offset: Annotated[int, Query(ge=0, lt=1 << 31)] = 0,
    ) -> Response:
        """Every space with whether it is free, how sure that is, and how old."""
        believed = await book.believed()
        kerb = believed.sheet.kerb
        rows = [row for row in range(len(kerb.space_ids)) if curb_zone_id in (None, kerb.zone_of[row].id)]
        chosen = where.chosen([(row, kerb.polygons[row]) for row in rows] if _in_force(time, surveyed_ms) else [])
        shown = [_space(row, believed, surveyed_ms) for row in chosen[offset : offset + MOST_AT_ONCE]]
        return answer({"spaces": shown}, believed, _next(request, offset, len(chosen)))

    @router.get("/curbs/spaces/{space_id}", responses={**responses, **problems(HTTPStatus.NOT_FOUND)})
    async def space(space_id: str) -> Response:
        """One space."""
        believed = await book.believed()
        row = _found(believed.sheet.kerb.row_of_space.get(space_id), "space")
        return answer({"space": _space(row, believed, surveyed_ms)}, believed)

    @router.get("/events/events", responses=responses)
    async def happened(
        request: Request,
        where: Area = in_area,
        curb_zone_id: _TEXT = None,
        curb_space_id: _TEXT = None,
        event_time: Annotated[str | None, Query(pattern=r"^\d{4}-\d\d-\d\dT\d\d$", description="UTC hour")] = None,
        before: Annotated[int | None, Query(ge=1, lt=1 << 62, description="Of a page's `next` link.")] = None,
    ) -> Response:
        """What passes of cars saw, newest first."""
        believed = await book.believed()
        told = await events.told(believed.now)
        chosen = events.select(told, believed.sheet, curb_zone_id, curb_space_id, event_time, before)
        chosen = where.chosen([(event, event.shape) for event in chosen])
        if where.point is not None:
            chosen.sort(key=lambda event: -event.number)
        page = chosen[:MOST_AT_ONCE]
        following = None
        if len(chosen) > len(page):
            following = str(request.url.include_query_params(before=page[-1].number))
        return answer({"events": [event.document for event in page]}, believed, following)

    for path, reason in _NOT_HERE.items():
        router.add_api_route(f"/{path}", _never(reason), responses=problems(HTTPStatus.NOT_IMPLEMENTED), name=path)
    return router


def _zone(zone: Zone, believed: BelievedSpots, surveyed_ms: int) -> dict[str, Any]:
    kerb = believed.sheet.kerb
    states = [believed.states[row] for row in zone.rows]
    free = [row for row in zone.rows if believed.states[row].occupancy is Occupancy.VACANT]
    seen = [state.observed_at for state in states if state.observed_at is not None]
    document: dict[str, Any] = {
        "curb_zone_id": zone.id,
        "geometry": zone.geometry,
        "curb_policy_ids": [],
        "published_date": surveyed_ms,
        "last_updated_date": surveyed_ms,
        "start_date": surveyed_ms,
        "length": zone.length_cm,
        "width": zone.width_cm,
        "num_spaces": len(zone.rows),
        "curb_space_ids": [kerb.space_ids[row] for row in zone.rows],
    }
    if zone.parking_angle is not None:
        document["parking_angle"] = zone.parking_angle
    if seen:  # how many are free is known as of the oldest look
        document["available_spaces"] = len(free)
        document["available_space_lengths"] = [int(kerb.length_cm[row]) for row in free]
        document["availability_time"] = round(1000 * min(seen))
        unknown = sum(state.occupancy is Occupancy.UNKNOWN for state in states)
        document["custom_attributes"] = {"unknown_spaces": str(unknown)}
    return document


def _space(row: int, believed: BelievedSpots, surveyed_ms: int) -> dict[str, Any]:
    state, sheet = believed.states[row], believed.sheet
    kerb = sheet.kerb
    document: dict[str, Any] = {
        "curb_space_id": kerb.space_ids[row],
        "geometry": sheet.geometries[row],
        "published_date": surveyed_ms,
        "last_updated_date": surveyed_ms,
        "curb_zone_id": kerb.zone_of[row].id,
        "space_number": kerb.zone_of[row].rows.index(row) + 1,
        "length": int(kerb.length_cm[row]),
        "width": int(kerb.width_cm[row]),
        "custom_attributes": {"spot_id": sheet.ids[row], "state": state.occupancy.value},
    }
    if state.observed_at is not None:
        age_s = max(believed.now - state.observed_at, 0.0)
        document["custom_attributes"] |= {
            "probability": f"{state.probability_vacant:.4f}",
            "observed_age_s": f"{age_s:.0f}",
        }
        if state.occupancy is not Occupancy.UNKNOWN:
            document["available"] = state.occupancy is Occupancy.VACANT
            document["availability_time"] = round(1000 * state.observed_at)
    return document


def _in_force(time_ms: int | None, surveyed_ms: int) -> bool:
    return time_ms is None or time_ms >= surveyed_ms


def _next(request: Request, offset: int, total: int) -> str | None:
    after = offset + MOST_AT_ONCE
    return str(request.url.include_query_params(offset=after)) if after < total else None


def _found(item: Any, kind: str) -> Any:
    if item is None:
        raise ProblemError(HTTPStatus.NOT_FOUND, "not_found", f"there is no {kind} of this id")
    return item


async def _check_version(accept: Annotated[str, Header(max_length=1000)] = "*/*") -> None:
    """CDS clients name the version that they understand."""
    versions = re.findall(r"application/vnd\.cds\+json\s*;\s*version=\"?(\d+(?:\.\d+)?)", accept)
    if versions and not {"1", "1.1"} & set(versions):
        raise ProblemError(HTTPStatus.NOT_ACCEPTABLE, "not_acceptable", "this is CDS 1.1")


def _never(reason: str) -> Any:
    async def not_implemented() -> None:
        """Optional in CDS, and not offered here."""
        raise ProblemError(HTTPStatus.NOT_IMPLEMENTED, "not_implemented", reason)

    return not_implemented
