"""The parking spots around the car, fetched anew as it drives on."""

from __future__ import annotations

import json
import logging

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.connection import CloudConnection, Reply
from autowaze.vehicle.tile_follower import expect_ok
from autowaze.world.errors import AutowazeError
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap

FETCHED_AROUND_M = 600.0
FETCHED_ANEW_AFTER_M = 300.0
"""From where was fetched last: within a window a car drives a fraction of it, and sees a fraction of what is left."""
MAX_SPOTS_BYTES = 1 << 26
"""Of a parking map: a city of 100,000 spots."""

_log = logging.getLogger(__name__)


class SpotFollower:
    """Knows where spots were fetched, and fetches those around the next place once the car is far enough from there.

    Args:
        connection: to the service; used by `follow` only.
        georeference: of the map frame that the car's positions are in.
    """

    def __init__(self, connection: CloudConnection, georeference: Georeference) -> None:
        self._connection = connection
        self._georeference = georeference
        self._asked_at: NDArray[np.float64] | None = None

    def follow(self, position_map: NDArray[np.float64]) -> ParkingMap | None:
        """The spots within `FETCHED_AROUND_M` of a map position (3,), perhaps none at all.

        None where the last ones will do, or the service cannot tell; then it is not asked again before the car is
        elsewhere.

        Raises:
            UnreachableError: the service does not answer.
        """
        here = np.array(position_map[:2], dtype=np.float64)
        if self._asked_at is not None and np.linalg.norm(here - self._asked_at) < FETCHED_ANEW_AFTER_M:
            return None
        corners = self._georeference.to_lon_lat(here + FETCHED_AROUND_M * np.array([[-1.0, -1.0], [1.0, 1.0]]))
        path = f"/parking_map.geojson?bbox={','.join(f'{degrees:.7f}' for degrees in corners.ravel())}"
        reply = self._connection.get(path, MAX_SPOTS_BYTES)
        self._asked_at = here
        return _spots_of(reply, f"{self._connection.url}{path}", self._georeference)


def fetch_spots(connection: CloudConnection) -> ParkingMap | None:
    """Where the service has parking spots, all of them; None if it cannot tell, and the car does without.

    Raises:
        UnreachableError: the service does not answer.
    """
    return _spots_of(connection.get("/parking_map.geojson", MAX_SPOTS_BYTES), f"{connection.url}/parking_map.geojson")


def _spots_of(reply: Reply, source: str, georeference: Georeference | None = None) -> ParkingMap | None:
    try:
        expect_ok(reply, source)
        document = json.loads(reply.body)
        if georeference is not None and isinstance(document, dict) and document.get("features") == []:
            return ParkingMap((), georeference)
        return ParkingMap.from_document(document, source)
    except (AutowazeError, ValueError, RecursionError) as error:
        _log.warning("the ground is told of as before: %s", error)
        return None
