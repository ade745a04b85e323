"""What clients that follow the service are sent, for the AsyncAPI document."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field

State = Literal["vacant", "occupied", "unknown"]
Probability = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(description="Seconds since the epoch (UTC).")]


class ChangedSpot(BaseModel):
    """A spot that is believed to be otherwise than before."""

    spot_id: str
    state: State
    probability_vacant: Probability
    observed_at: Seconds | None


class ChangedSpots(BaseModel):
    """The spots that one diff changed."""

    spots: list[ChangedSpot]


class Nothing(BaseModel):
    """There is no more to say."""


class ChangedParkingMap(BaseModel):
    """Spots were drawn anew."""

    version: int = Field(description="Of the parking map.")


class ChangeMessage(BaseModel):
    """An event over a WebSocket; `data` is what a server-sent event of this kind has."""

    event: Literal["spots", "current", "reset", "parking_map"]
    version: int = Field(description="Of the map; come back with ?since= this.")
    data: ChangedSpots | ChangedParkingMap | Nothing


class MovedCar(BaseModel):
    """What is new of a car's way."""

    car: str = Field(description="A pseudonym that changes with the car's session and with every start.")
    path: list[Annotated[list[float], Field(min_length=4, max_length=4)]] = Field(
        description="Longitude, latitude, heading in degrees clockwise from north, seconds since the epoch (UTC)."
    )


class ArrivedDiff(BaseModel):
    """A diff that was accepted."""

    car: str
    sequence: int
    bytes: int
    new: int = Field(description="Features that it adds.")
    removed: int = Field(description="Features that it removes.")
    received_at: Seconds
    map_version: int


class DiffAcknowledgement(BaseModel):
    """What became of a diff."""

    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="Of the bytes of the diff.")
    verdict: Literal["accepted", "repeated", "refused", "later"]
    reason: str
    map_version: int | None
    wait_s: float | None = Field(description="How long to wait before it is sent again.")
    seal: str | None = Field(
        None, description="Shows a car with a token that the service said this; see the wire format."
    )


class SpotOfTile(BaseModel):
    """A spot and what was believed of it when it was last observed."""

    spot_id: str
    lon: float
    lat: float
    state: State
    probability_vacant: Probability
    observed_at: Seconds | None


class SpotsOfTile(BaseModel):
    """Every spot of a tile."""

    tile: Annotated[list[int], Field(min_length=3, max_length=3)] = Field(description="Zoom, x, y (web mercator).")
    version: int = Field(description="Of the map.")
    spots: list[SpotOfTile]


class MapOfTile(BaseModel):
    """The map of a tile changed: fetch what is lacking over HTTP."""

    version: int
