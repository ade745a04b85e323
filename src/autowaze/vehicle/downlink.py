"""What the car fetches from the service: the stored map, and what changed in it since."""

from __future__ import annotations

from http import HTTPStatus

from autowaze.vehicle.connection import CloudConnection, Reply
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.wire import MAX_MAP_BYTES, decode_map, decode_map_update


def fetch_map(connection: CloudConnection) -> FeatureMap:
    """The service's map.

    Raises:
        UnreachableError: the service does not answer.
        AutowazeError: it does not give the map away, or it is none.
    """
    reply = connection.get("/map", MAX_MAP_BYTES)
    _expect_ok(reply, f"{connection.url}/map")
    return decode_map(reply.body)


def brought_up_to_date(feature_map: FeatureMap, connection: CloudConnection) -> FeatureMap:
    """The map with what changed since its version; fetched whole where it is too old. Raises as `fetch_map` does."""
    reply = connection.get(f"/map/updates?since={feature_map.version}", MAX_MAP_BYTES)
    if reply.status == HTTPStatus.GONE:
        return fetch_map(connection)
    _expect_ok(reply, f"{connection.url}/map/updates")
    return decode_map_update(reply.body).applied_to(feature_map)


def _expect_ok(reply: Reply, address: str) -> None:
    if reply.status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
        raise AutowazeError(f"{address}: needs a token with scope map; make one with: autowaze cloud token add NAME")
    if reply.status != HTTPStatus.OK:
        raise AutowazeError(f"{address}: the service answered {reply.status}")
