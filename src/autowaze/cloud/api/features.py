"""The spots as OGC API - Features, part 1: core (OGC 17-069r4), so that QGIS and others open them by URL."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from http import HTTPStatus
from typing import Annotated, Any
from urllib.parse import quote, urlencode

import numpy as np
from fastapi import APIRouter, Depends, Query, Request, Response
from numpy.typing import NDArray

from autowaze.cloud.api.bounding_box import BBOX, box_asked_for
from autowaze.cloud.api.dashboard import Dashboard, wants_page
from autowaze.cloud.api.problems import ProblemError, problems
from autowaze.cloud.api.spot_book import SpotBook
from autowaze.cloud.api.spots import GEOJSON, SpotCollection, SpotFeature, json_response

CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
CONFORMANCE = [
    f"http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/{part}" for part in ("core", "geojson", "oas30")
]
MOST_ITEMS = 1000
_OPENAPI = "application/vnd.oai.openapi+json;version=3.0"

Link = dict[str, str]
_Limit = Annotated[
    int,
    # More is no error but means the most (OGC 17-069r4, /req/core/fc-limit-response-1).
    Query(ge=1, description="At most so many at once.", json_schema_extra={"maximum": MOST_ITEMS}),
]


def feature_routes(book: SpotBook, dashboard: Dashboard) -> APIRouter:
    """`/`, `/conformance`, `/collections`, `/collections/spots`, its items and each of them."""
    router = APIRouter(
        tags=["OGC API Features"],
        dependencies=[Depends(_only_known_parameters)],
        responses=problems(HTTPStatus.BAD_REQUEST),
    )

    @router.get(
        "/",
        response_model=None,
        responses={200: {"model": dict[str, Any], "content": {"text/html": {}}}, 304: {"description": "Not modified"}},
    )
    async def landing_page(request: Request, response: Response) -> dict[str, Any] | Response:
        """Where everything is; for browsers, and with `?f=html`, the live map."""
        if wants_page(request):
            return dashboard.page(request)
        response.headers["Vary"] = "Accept"
        return {
            "title": "Autowaze",
            "description": "Parking spots and whether they are free, as seen by cars that drive by",
            "links": [
                _link(request, "/", "self"),
                _link(request, "/openapi.json", "service-desc", _OPENAPI),
                _link(request, "/conformance", "conformance"),
                _link(request, "/collections", "data"),
            ],
        }

    @router.get("/conformance")
    async def conformance() -> dict[str, list[str]]:
        """What of the standard is implemented."""
        return {"conformsTo": CONFORMANCE}

    @router.get("/collections")
    async def collections(request: Request) -> dict[str, Any]:
        """The one collection."""
        return {"links": [_link(request, "/collections", "self")], "collections": [_collection(request, book)]}

    @router.get("/collections/spots")
    async def collection(request: Request) -> dict[str, Any]:
        """What the collection of spots is and where it lies."""
        return _collection(request, book)

    @router.get(
        "/collections/spots/items",
        responses={
            200: {"model": SpotCollection, "content": {GEOJSON: {}}},
            **problems(HTTPStatus.BAD_REQUEST),
        },
    )
    async def items(
        request: Request,
        limit: _Limit = 100,
        offset: Annotated[int, Query(ge=0, lt=1 << 31, description="Skip so many.")] = 0,
        bbox: BBOX = None,
        datetime: Annotated[str | None, Query(max_length=100, description="RFC 3339 time or interval")] = None,
    ) -> Response:
        """Spots with state, probability and age, a page at a time, in the order of the parking map."""
        limit = min(limit, MOST_ITEMS)
        box = box_asked_for(bbox) if bbox is not None else None
        believed = await book.believed()
        sheet = believed.sheet
        rows = np.arange(len(sheet)) if box is None else np.sort(sheet.tree.query(box, predicate="intersects"))
        if datetime is not None:
            rows = _observed_in(rows, believed.states.observed_at(rows), datetime)
        page = rows[offset : offset + limit].tolist()
        given = {k: v for k, v in (("bbox", bbox), ("datetime", datetime)) if v is not None}
        links = [_page_link(request, "self", given, limit, offset)]
        if offset + limit < len(rows):
            links.append(_page_link(request, "next", given, limit, offset + limit))
        if offset > 0:
            links.append(_page_link(request, "prev", given, limit, max(offset - limit, 0)))
        document = {
            "type": "FeatureCollection",
            "map_version": believed.version,
            "numberMatched": len(rows),
            "numberReturned": len(page),
            "timeStamp": _rfc3339(believed.now),
            "links": links,
            "features": [believed.feature(row) for row in page],
        }
        return json_response(document, GEOJSON)

    @router.get(
        "/collections/spots/items/{spot_id}",
        responses={200: {"model": SpotFeature, "content": {GEOJSON: {}}}, **problems(HTTPStatus.NOT_FOUND)},
    )
    async def item(request: Request, spot_id: str) -> Response:
        """One spot."""
        believed = await book.believed()
        row = believed.sheet.row_of.get(spot_id)
        if row is None:
            raise ProblemError(HTTPStatus.NOT_FOUND, "not_found", f"there is no spot {spot_id[:100]!r}")
        feature = believed.feature(row)
        feature["links"] = [
            _link(request, f"/collections/spots/items/{quote(spot_id, safe='')}", "self", GEOJSON),
            _link(request, "/collections/spots", "collection"),
        ]
        return json_response(feature, GEOJSON)

    return router


async def _only_known_parameters(request: Request) -> None:
    """Refuse a parameter that a route does not have, as the standard has it (/req/core/query-param-unknown)."""
    route = request.scope["route"]
    if route.path == "/":  # of the live map, whose links may say anything
        return
    known = {"f", *(parameter.alias for parameter in route.dependant.query_params)}
    unknown = sorted(set(request.query_params) - known)
    if unknown:
        said = f"no such parameter: {unknown[0][:100]!r}; there are {', '.join(sorted(known))}"
        raise ProblemError(HTTPStatus.BAD_REQUEST, "bad_parameter", said)


def _collection(request: Request, book: SpotBook) -> dict[str, Any]:
    bounds = book.sheet.bounds_lon_lat
    return {
        "id": "spots",
        "title": "Parking spots",
        "description": "State, probability and age of every spot",
        "itemType": "feature",
        "crs": [CRS84],
        "extent": {"spatial": {"bbox": [[*bounds[:, :2].min(axis=0), *bounds[:, 2:].max(axis=0)]], "crs": CRS84}},
        "links": [
            _link(request, "/collections/spots", "self"),
            _link(request, "/collections/spots/items", "items", GEOJSON),
        ],
    }


def _observed_in(rows: NDArray[np.int64], seen: list[float | None], text: str) -> NDArray[np.int64]:
    """Those of the spots that were last observed in a time or interval; one never observed has no time and stays."""
    first, _, last = text.partition("/")
    begin = -math.inf if first in ("", "..") else _seconds(first)
    if "/" not in text:
        last = first
    end = math.inf if last in ("", "..") else _seconds(last)
    if begin > end or text in ("", "..", "/", "../.."):
        raise ProblemError(HTTPStatus.BAD_REQUEST, "bad_parameter", "datetime: the interval is empty")
    return rows[[moment is None or begin <= moment < end + 1.0 for moment in seen]]


def _seconds(text: str) -> float:
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        raise ProblemError(HTTPStatus.BAD_REQUEST, "bad_parameter", "datetime: expected RFC 3339 times") from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _rfc3339(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _link(request: Request, path: str, relation: str, media_type: str = "application/json") -> Link:
    return {"href": f"{str(request.base_url).rstrip('/')}{path}", "rel": relation, "type": media_type}


def _page_link(request: Request, relation: str, given: dict[str, str], limit: int, offset: int) -> Link:
    query = urlencode({**given, "limit": limit, "offset": offset})
    return _link(request, f"/collections/spots/items?{query}", relation, GEOJSON)
