"""What comes down to the car: the stored map, what changed in it, and the spots that are free."""

from __future__ import annotations

import logging
import random
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.spot_follower import SpotFollower
from autowaze.vehicle.tile_follower import TileFollower, expect_ok, map_frame_at
from autowaze.vehicle.vacant_spots import VacantSpot, nearest_vacant
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.frame import GnssFix
from autowaze.world.georeference import Georeference
from autowaze.world.map_update import MapUpdate
from autowaze.world.parking import ParkingMap
from autowaze.world.wire import MAX_MAP_BYTES, decode_map, decode_map_update

FIRST_WAIT_S, LONGEST_WAIT_S = 2.0, 60.0
CLOSE_S = 5.0
"""How long the end of a drive waits for an answer that is under way."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Arrivals:
    """What had come down when a window ended.

    Attributes:
        map: what changes the stored map; None for nothing.
        vacant: the nearest free spots as last heard, nearest first.
        spots: where people park around here, which the car tells of the ground at; None for as it was.
    """

    map: MapUpdate | None = None
    vacant: Sequence[VacantSpot] = ()
    spots: ParkingMap | None = None


class Downlink(Protocol):
    """Where a drive asks, at the end of each window, for what has come down."""

    def arrivals(self, position_map: NDArray[np.float64]) -> Arrivals:
        """What has come down by now; the car is at this map position (3,). Never waits."""


@dataclass
class RecordedDownlink:
    """What came down in an earlier drive comes down again, at the ends of the same windows.

    Attributes:
        updates, spots: by number of the window, counted from 0.
    """

    updates: Mapping[int, MapUpdate]
    spots: Mapping[int, ParkingMap] = field(default_factory=dict)
    _window: int = field(default=-1, init=False)

    def arrivals(self, position_map: NDArray[np.float64]) -> Arrivals:
        """What came down then."""
        self._window += 1
        return Arrivals(self.updates.get(self._window), spots=self.spots.get(self._window))


class LiveDownlink:
    """Asks the service for what is around the car, in a thread of its own: the drive never waits for the network.

    One update at most waits to be taken; while nobody takes it nothing more is fetched.

    Args:
        connection: to the service; used by the thread only.
        follower: of the car's map, over the same connection.
        georeference: of the map frame.
        randomness: 0..1, spreads the retries of many cars after an outage.
    """

    def __init__(
        self,
        connection: CloudConnection,
        follower: TileFollower,
        georeference: Georeference,
        randomness: Callable[[], float] = random.random,
    ) -> None:
        self.trouble = ""
        """Why the last try failed; empty after one that did not."""
        self._connection = connection
        self._follower = follower
        self._georeference = georeference
        self._randomness = randomness
        self._changed = threading.Condition()
        self._position: NDArray[np.float64] | None = None
        self._update: MapUpdate | None = None
        self._vacant: Sequence[VacantSpot] = ()
        self._spot_follower = SpotFollower(connection, georeference)
        self._spots: ParkingMap | None = None
        self._asking = False
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="downlink", daemon=True)
        self._thread.start()

    def arrivals(self, position_map: NDArray[np.float64]) -> Arrivals:
        """What has come down by now, and from where on to look next."""
        with self._changed:
            update, self._update = self._update, None
            spots, self._spots = self._spots, None
            self._position = np.array(position_map, dtype=np.float64)
            self._changed.notify_all()
            return Arrivals(update, self._vacant, spots)

    def settle(self, timeout_s: float) -> bool:
        """Wait until the service was asked for the last position, or something waits; False when time is up."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._update is not None or (self._position is None and not self._asking), timeout_s
            )

    def close(self) -> None:
        """Stop."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        self._thread.join(CLOSE_S)
        self._connection.close()

    def _run(self) -> None:
        failures = 0
        while (position := self._next_position()) is not None:
            failures = failures + 1 if self._ask(position) else 0
            if failures:
                longest_s = min(FIRST_WAIT_S * 2.0 ** min(failures - 1, 10), LONGEST_WAIT_S)
                self._pause(longest_s * (0.5 + 0.5 * self._randomness()))

    def _next_position(self) -> NDArray[np.float64] | None:
        """Where the car is, once it has moved on and taken what came; None for the order to stop."""
        with self._changed:
            self._changed.wait_for(lambda: self._stopping or (self._position is not None and self._update is None))
            position, self._position = self._position, None
            self._asking = position is not None
            return None if self._stopping else position

    def _ask(self, position: NDArray[np.float64]) -> str:
        """Ask once; returns what went wrong."""
        update, vacant, spots, trouble = None, self._vacant, None, ""
        try:
            update = self._follower.follow(position)
            spots = self._spot_follower.follow(position)
            lon, lat = self._georeference.to_lon_lat(position[None])[0].tolist()
            vacant = nearest_vacant(self._connection, lon, lat)
        except AutowazeError as error:
            trouble = str(error)
        except Exception as error:  # whatever a service sends, the car drives on
            _log.error("the downlink failed", exc_info=error)
            trouble = repr(error)
        if trouble and not self.trouble:
            _log.warning("%s; the drive goes on with the map that it has", trouble)
        with self._changed:
            self._update, self._vacant, self.trouble = update, vacant, trouble
            self._spots = self._spots if spots is None else spots
            self._asking = False
            self._changed.notify_all()
        return trouble

    def _pause(self, wait_s: float) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._stopping, wait_s)


def fetch_map(connection: CloudConnection) -> FeatureMap:
    """The service's map, the whole of it.

    Raises:
        UnreachableError: the service does not answer.
        AutowazeError: it does not give the map away, or it is none.
    """
    reply = connection.get("/map", MAX_MAP_BYTES)
    expect_ok(reply, f"{connection.url}/map")
    return decode_map(reply.body)


def fetch_map_around(connection: CloudConnection, fix: GnssFix) -> FeatureMap:
    """The tiles of the service's map around a place; raises as `TileFollower.follow` does."""
    georeference = map_frame_at(connection, fix.lon_deg, fix.lat_deg)
    here = georeference.to_map(np.array([[fix.lon_deg, fix.lat_deg]]))[0]
    empty = FeatureMap(georeference=georeference)
    update = TileFollower(connection, georeference).follow(here)
    return empty if update is None else update.applied_to(empty)


def brought_up_to_date(feature_map: FeatureMap, connection: CloudConnection) -> FeatureMap:
    """The map with what changed since its version; fetched whole where it is too old. Raises as `fetch_map` does."""
    reply = connection.get(f"/map/updates?since={feature_map.version}", MAX_MAP_BYTES)
    if reply.status == HTTPStatus.GONE:
        return fetch_map(connection)
    expect_ok(reply, f"{connection.url}/map/updates")
    return decode_map_update(reply.body).applied_to(feature_map)
