"""What a driver is shown: the nearest spots that are probably free."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus

from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.tile_follower import expect_ok
from autowaze.world.errors import AutowazeError

MOST_SHOWN = 5
_MOST_BYTES = 1 << 20
_MOST_NAME = 80


@dataclass(frozen=True)
class VacantSpot:
    """One spot, as the service told it.

    Attributes:
        lon, lat: degrees, WGS84.
        distance_m: to drive.
        probability: that it is still free on arrival.
    """

    spot_id: str
    lon: float
    lat: float
    distance_m: float
    probability: float

    def __str__(self) -> str:
        return f"{self.spot_id} in {self.distance_m:.0f} m ({self.probability:.0%})"


def nearest_vacant(connection: CloudConnection, lon_deg: float, lat_deg: float) -> list[VacantSpot]:
    """The nearest spots that are free, nearest first.

    Raises:
        UnreachableError: the service does not answer.
        AutowazeError: what it answers is no list of spots.
    """
    where = f"/nearest?lon={lon_deg:.6f}&lat={lat_deg:.6f}&limit={MOST_SHOWN}&mode=driving"
    reply = connection.get(where, _MOST_BYTES)
    if reply.status == HTTPStatus.NOT_FOUND:  # an older service
        return []
    expect_ok(reply, f"{connection.url}/nearest")
    try:
        return [_spot(item) for item in json.loads(reply.body)["spots"][:MOST_SHOWN]]
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        raise AutowazeError(f"{connection.url}/nearest: not a list of spots: {error!r}") from error


def in_words(spots: Sequence[VacantSpot]) -> str:
    """A line for a small display."""
    return "free near here: " + ", ".join(map(str, spots)) if spots else "no free spot known near here"


def _spot(item: dict[str, object]) -> VacantSpot:
    numbers = [float(str(item[key])) for key in ("lon", "lat", "distance_m", "probability_on_arrival")]
    lon, lat, distance_m, probability = numbers
    if not all(map(math.isfinite, numbers)) or not (0 <= probability <= 1 and distance_m >= 0):
        raise ValueError("a number out of range")
    name = "".join(c for c in str(item["spot_id"])[:_MOST_NAME] if c.isprintable())
    return VacantSpot(name, lon, lat, distance_m, probability)
