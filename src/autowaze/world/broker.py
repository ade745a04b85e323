"""An MQTT broker: where it is, and what its topics are called."""

from __future__ import annotations

import re
import secrets
from dataclasses import dataclass, field
from urllib.parse import unquote, urlsplit

from autowaze.world.errors import AutowazeError

ROOT = "autowaze/v1"
EVERY_DIFF = f"{ROOT}/diffs/+"
_DIFFS_OF = re.compile(re.escape(ROOT) + r"/diffs/([A-Za-z0-9_-]{8,64})")


@dataclass(frozen=True)
class BrokerAddress:
    """Where a broker listens and how to log in to it.

    Attributes:
        username, password: the broker's own; the service's tokens are another thing and never reach the broker.
    """

    host: str
    port: int
    tls: bool = False
    username: str | None = None
    password: str | None = field(default=None, repr=False)

    @classmethod
    def parse(cls, url: str) -> BrokerAddress:
        """The address in mqtt[s]://[user[:password]@]host[:port]; raises `AutowazeError` if it is none."""
        parts = urlsplit(url)
        try:
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if parts.scheme not in ("mqtt", "mqtts") or not host or parts.path.strip("/") or parts.query:
            raise AutowazeError("not the URL of a broker, such as mqtts://broker.example:8883")
        tls = parts.scheme == "mqtts"
        username, password = (None if part is None else unquote(part) for part in (parts.username, parts.password))
        return cls(host, port or (8883 if tls else 1883), tls, username, password)

    def __str__(self) -> str:
        return f"{'mqtts' if self.tls else 'mqtt'}://{self.host}:{self.port}"


def diffs_topic(car: str) -> str:
    """Where a car publishes its diffs."""
    return f"{ROOT}/diffs/{car}"


def acks_topic(car: str) -> str:
    """Where the service answers it."""
    return f"{ROOT}/acks/{car}"


def spots_topic(zoom: int, x: int, y: int) -> str:
    """Where the states of a tile's spots are retained."""
    return f"{ROOT}/spots/{zoom}/{x}/{y}"


def map_topic(zoom: int, x: int, y: int) -> str:
    """Where the version of a tile's map is retained."""
    return f"{ROOT}/map/{zoom}/{x}/{y}"


def car_of_topic(topic: str) -> str | None:
    """The car that published on a topic for diffs; None if no car is called so."""
    found = _DIFFS_OF.fullmatch(topic)
    return found[1] if found else None


def new_car() -> str:
    """A name for one session at the broker: says nothing about the car, and nobody can guess it."""
    return secrets.token_hex(16)
