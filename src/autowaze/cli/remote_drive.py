"""One car that talks to a service elsewhere: `autowaze drive --cloud URL`."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from autowaze.cli.options import console
from autowaze.traces import Trace
from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.downlink import Arrivals, LiveDownlink, fetch_map, fetch_map_around
from autowaze.vehicle.node import StartingPoint
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.spot_follower import SpotFollower, fetch_spots
from autowaze.vehicle.tile_follower import TileFollower
from autowaze.vehicle.transports import public_address, service_address, transport_to
from autowaze.vehicle.uplink import Uplink
from autowaze.vehicle.vacant_spots import in_words
from autowaze.world.feature_map import FeatureMap
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap

PATIENCE_S = 30.0
"""How long a finished drive waits for its last diffs to be acknowledged."""


@dataclass(frozen=True)
class RemoteCloud:
    """How to reach the service.

    Attributes:
        url: where diffs go: the service, or a broker.
        service: where the map is fetched; None for the host of `url`.
        token: what the service knows the car by.
    """

    url: str
    service: str | None = None
    token: str | None = None

    @property
    def name(self) -> str:
        """Where diffs go, without a broker's log-in."""
        return public_address(self.url)

    def connect(self) -> CloudConnection:
        """A connection for requests; raises `AutowazeError` where only a broker is known."""
        return CloudConnection(service_address(self.url, self.service), self.token)

    @property
    def has_service(self) -> bool:
        """Whether it is known where requests are answered."""
        return self.service is not None or not self.url.startswith("mqtt")


def first_map(cloud: RemoteCloud, source: Trace) -> FeatureMap:
    """The service's map to begin with: the tiles around the drive's first fix, all of it where there is none."""
    fix = next(iter(source)).gnss
    with cloud.connect() as connection:
        feature_map = fetch_map(connection) if fix is None else fetch_map_around(connection, fix)
        console.print(f"{connection.url}: map of version {feature_map.version}, {len(feature_map):,} features")
    return feature_map


def known_spots(cloud: RemoteCloud, source: Trace, georeference: Georeference | None) -> ParkingMap | None:
    """Where the service has spots, around the drive's first fix if there is one; the car tells of the ground there."""
    if not cloud.has_service:
        return None
    fix = next(iter(source)).gnss
    with cloud.connect() as connection:
        if fix is None or georeference is None:
            return fetch_spots(connection)
        here = georeference.to_map(np.array([[fix.lon_deg, fix.lat_deg]]))[0]
        return SpotFollower(connection, georeference).follow(here)


def in_the_services_frame(start: StartingPoint, feature_map: FeatureMap) -> StartingPoint:
    """The start in the service's map frame: an empty map has one too, and diffs in another are refused."""
    return replace(start, georeference=feature_map.georeference or start.georeference)


@contextmanager
def uplink_to(cloud: RemoteCloud, outbox: Path | None) -> Iterator[Uplink]:
    """An uplink that, at the end, waits for the service for a while and says what is left."""
    uplink = Uplink(Outbox(outbox or default_outbox(cloud.name)), transport_to(cloud.url, cloud.token))
    try:
        yield uplink
        if not uplink.flush(PATIENCE_S):
            console.print(f"{len(uplink.outbox)} diffs wait in {uplink.outbox.folder} for the next drive")
            console.print(f"the service does not take them: {uplink.trouble or 'it is slow'}")
        console.print(f"{uplink.acknowledged} diffs acknowledged, {uplink.refused} refused by {cloud.name}")
    finally:
        uplink.close()


@contextmanager
def downlink_from(cloud: RemoteCloud, stored: FeatureMap) -> Iterator[LiveDownlink | None]:
    """The map around the car as it changes; None where nobody can be asked, or the map floats freely."""
    if not cloud.has_service or stored.georeference is None:
        yield None
        return
    connection = cloud.connect()
    follower = TileFollower(connection, stored.georeference, stored)
    downlink = LiveDownlink(connection, follower, stored.georeference)
    try:
        yield downlink
    finally:
        downlink.close()


def show_arrivals(arrivals: Arrivals) -> None:
    """The driver's display: a line for each window."""
    update = arrivals.map
    news = f"map {update.to_version}: +{len(update.added)} -{len(update.removed)}; " if update else ""
    console.print(news + in_words(arrivals.vacant), markup=False, highlight=False)


def default_outbox(url: str) -> Path:
    """A folder of this user for diffs to this service."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return state / "autowaze" / "outbox" / hashlib.sha256(url.encode()).hexdigest()[:16]
