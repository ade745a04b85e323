"""Which transport carries diffs to an address."""

from __future__ import annotations

from urllib.parse import urlsplit

from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.uplink import HttpTransport, Transport
from autowaze.world.broker import BrokerAddress
from autowaze.world.errors import AutowazeError


def transport_to(url: str, token: str | None) -> Transport:
    """A transport to a service (http, https, ws, wss) or to the broker that it listens at (mqtt, mqtts).

    Raises:
        AutowazeError: the URL or the token is none.
    """
    scheme = urlsplit(url).scheme
    if scheme in ("mqtt", "mqtts"):
        from autowaze.vehicle.mqtt import MqttTransport

        return MqttTransport(BrokerAddress.parse(url), token)
    if scheme in ("ws", "wss"):
        from autowaze.vehicle.websocket import WebSocketTransport

        return WebSocketTransport(url, token)
    return HttpTransport(CloudConnection(url, token))


def public_address(url: str) -> str:
    """The address without a broker's log-in, to show and to name things after."""
    return str(BrokerAddress.parse(url)) if urlsplit(url).scheme in ("mqtt", "mqtts") else url


def service_address(url: str, service: str | None = None) -> str:
    """Where the service answers requests: stated, or the same host.

    Raises:
        AutowazeError: a broker does not tell.
    """
    scheme = urlsplit(url).scheme
    if service is not None:
        return service
    if scheme in ("mqtt", "mqtts"):
        raise AutowazeError(
            "a broker has no map: say where the service is with --service URL, or give a map with --map FILE"
        )
    return {"ws": "http", "wss": "https"}.get(scheme, scheme) + url[len(scheme) :]
