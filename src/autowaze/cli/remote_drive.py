"""One car that talks to a service elsewhere: `autowaze drive --cloud URL`."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from autowaze.cli.options import console
from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.downlink import fetch_map
from autowaze.vehicle.node import StartingPoint
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.uplink import HttpTransport, Uplink
from autowaze.world.feature_map import FeatureMap

PATIENCE_S = 30.0
"""How long a finished drive waits for its last diffs to be acknowledged."""


def service_map(url: str, token: str | None) -> FeatureMap:
    """The map of the service, to localise in."""
    with CloudConnection(url, token) as connection:
        feature_map = fetch_map(connection)
    console.print(f"{url}: map of version {feature_map.version}, {len(feature_map):,} features")
    return feature_map


def in_the_services_frame(start: StartingPoint, feature_map: FeatureMap) -> StartingPoint:
    """The start in the service's map frame: an empty map has one too, and diffs in another are refused."""
    return replace(start, georeference=feature_map.georeference or start.georeference)


@contextmanager
def uplink_to(url: str, token: str | None, outbox: Path | None) -> Iterator[Uplink]:
    """An uplink that, at the end, waits for the service for a while and says what is left."""
    uplink = Uplink(Outbox(outbox or default_outbox(url)), HttpTransport(CloudConnection(url, token)))
    try:
        yield uplink
        if not uplink.flush(PATIENCE_S):
            console.print(f"{len(uplink.outbox)} diffs wait in {uplink.outbox.folder} for the next drive")
            console.print(f"the service does not take them: {uplink.trouble or 'it is slow'}")
        console.print(f"{uplink.acknowledged} diffs acknowledged, {uplink.refused} refused by {url}")
    finally:
        uplink.close()


def default_outbox(url: str) -> Path:
    """A folder of this user for diffs to this service."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return state / "autowaze" / "outbox" / hashlib.sha256(url.encode()).hexdigest()[:16]
