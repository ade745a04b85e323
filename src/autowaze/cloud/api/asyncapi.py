"""The AsyncAPI 3.0 document: what passes over event streams, WebSockets and an MQTT broker."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response
from pydantic.json_schema import models_json_schema

from autowaze import __version__
from autowaze.cloud.api import event_models as events
from autowaze.cloud.api.spots import json_response
from autowaze.world.broker import ROOT, BrokerAddress, acks_topic, diffs_topic
from autowaze.world.tiles import TILE_ZOOM

MEDIA_TYPE = "application/vnd.aai.asyncapi+json;version=3.0.0"
OCTETS = "application/octet-stream"
_MODELS = (
    *(events.ChangedSpots, events.Nothing, events.ChangedParkingMap, events.ChangeMessage, events.MovedCar),
    *(events.ArrivedDiff, events.DiffAcknowledgement, events.SpotsOfTile, events.MapOfTile),
)

Json = dict[str, Any]


def asyncapi_document(host: str, tls: bool, broker: BrokerAddress | None) -> Json:
    """The document of a service.

    Args:
        host: where clients reach it, with port.
        tls: whether they do so by TLS.
        broker: without one the topics are left out.
    """
    channels, operations = _streams()
    servers: Json = {
        "http": {"host": host, "protocol": "https" if tls else "http", "description": "Server-sent events."},
        "sockets": {"host": host, "protocol": "wss" if tls else "ws", "description": "WebSockets."},
    }
    if broker is not None:
        protocol = "secure-mqtt" if broker.tls else "mqtt"
        where = f"{broker.host}:{broker.port}"
        servers["broker"] = {"host": where, "protocol": protocol, "protocolVersion": "5", "description": "3.1.1, too."}
        topics, by_mqtt = _topics()
        channels |= topics
        operations |= by_mqtt
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "Autowaze",
            "version": __version__,
            "description": "Parking spots as they turn free and taken, and the cars that see it.",
            "license": {"name": "Apache-2.0"},
        },
        "defaultContentType": "application/json",
        "servers": servers,
        "channels": channels,
        "operations": operations,
        "components": {"schemas": _schemas(), "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}},
    }


def asyncapi_routes(broker: BrokerAddress | None) -> APIRouter:
    """`/asyncapi.json`."""
    router = APIRouter(tags=["operation"])

    @router.get("/asyncapi.json", response_class=Response, responses={200: {"content": {MEDIA_TYPE: {}}}})
    async def asyncapi(request: Request) -> Response:
        """What the service sends by itself, for programs (AsyncAPI 3.0)."""
        url = request.base_url
        return json_response(asyncapi_document(url.netloc, url.scheme == "https", broker), MEDIA_TYPE)

    return router


def _streams() -> tuple[Json, Json]:
    """Channels and operations over HTTP and WebSockets."""
    changes = {
        "spots": _message("ChangedSpots", "These spots changed."),
        "current": _message("Nothing", "The client has missed nothing."),
        "reset": _message("Nothing", "Some changes were missed: fetch /spots.geojson."),
        "parking_map": _message("ChangedParkingMap", "Spots were drawn anew: fetch /spots.geojson."),
    }
    since = {"type": "object", "properties": {"since": {"type": "integer", "minimum": 0}}}
    upgrade = {"ws": {"method": "GET", "query": since, "bindingVersion": "0.1.0"}}
    channels = {
        "changes": _channel("/changes", "Changes of spots.", changes, "http"),
        "changesBySocket": {
            **_channel("/changes/ws", "The same.", {"change": _message("ChangeMessage", "An event.")}, "sockets"),
            "bindings": upgrade,
        },
        "fleet": _channel(
            "/fleet/changes",
            "Cars as they drive, for operators.",
            {"car": _message("MovedCar", "A car moved."), "diff": _message("ArrivedDiff", "A diff was accepted.")},
            "http",
        ),
        "diffsBySocket": {
            **_channel(
                "/v1/diffs/ws",
                "Diffs of one car, one after the other.",
                {"diff": _diff("A semantic map diff: see the wire format."), "acknowledgement": _acknowledgement()},
                "sockets",
            ),
            "bindings": {"ws": {"method": "GET", "bindingVersion": "0.1.0"}},
        },
    }
    get = {"http": {"method": "GET", "bindingVersion": "0.3.0"}}
    resume = {"http": {"method": "GET", "query": since, "bindingVersion": "0.3.0"}}
    operations = {
        "tellChanges": {**_sends("changes", changes), "bindings": resume},
        "tellChangesBySocket": _sends("changesBySocket", ["change"]),
        "tellFleet": {**_sends("fleet", ["car", "diff"]), "bindings": get, "security": _token("operator")},
        "takeDiffsBySocket": {
            **_receives("diffsBySocket", "diff", "diffsBySocket", "acknowledgement"),
            "security": _token("diffs"),
        },
    }
    return channels, operations


def _topics() -> tuple[Json, Json]:
    """Channels and operations over an MQTT broker."""
    car = {"car": {"description": "A name that the car draws by chance for each session at the broker."}}
    tile = {axis: {"description": f"{axis} of the tile at zoom {TILE_ZOOM} (web mercator)."} for axis in "xy"}
    channels = {
        "diffs": {
            **_channel(
                diffs_topic("{car}"), "Diffs of one car.", {"diff": _diff("A diff, signed: see the wire format.")}
            ),
            "parameters": car,
        },
        "acks": {
            **_channel(acks_topic("{car}"), "What became of them.", {"acknowledgement": _acknowledgement()}),
            "parameters": car,
        },
        "spotsOfTile": {
            **_channel(
                f"{ROOT}/spots/{TILE_ZOOM}/{{x}}/{{y}}",
                "The spots of a tile.",
                {"spots": _message("SpotsOfTile", "Every spot of the tile.")},
            ),
            "parameters": tile,
        },
        "mapOfTile": {
            **_channel(
                f"{ROOT}/map/{TILE_ZOOM}/{{x}}/{{y}}",
                "The version of a tile's map.",
                {"map": _message("MapOfTile", "Its map changed.")},
            ),
            "parameters": tile,
        },
    }
    surely = {"mqtt": {"qos": 1, "bindingVersion": "0.2.0"}}
    retained = {"mqtt": {"qos": 1, "retain": True, "bindingVersion": "0.2.0"}}
    operations = {
        "takeDiffs": {**_receives("diffs", "diff", "acks", "acknowledgement"), "bindings": surely},
        "tellSpotsOfTile": {**_sends("spotsOfTile", ["spots"]), "bindings": retained},
        "tellMapOfTile": {**_sends("mapOfTile", ["map"]), "bindings": retained},
    }
    return channels, operations


def _channel(address: str, description: str, messages: Json, server: str = "broker") -> Json:
    where = [{"$ref": f"#/servers/{server}"}]
    return {"address": address, "description": description, "servers": where, "messages": messages}


def _message(model: str, summary: str) -> Json:
    return {"summary": summary, "payload": {"$ref": f"#/components/schemas/{model}"}}


def _diff(summary: str) -> Json:
    return {"summary": summary, "contentType": OCTETS, "payload": {"type": "string", "format": "binary"}}


def _acknowledgement() -> Json:
    return _message("DiffAcknowledgement", "What became of the diff with this hash.")


def _sends(channel: str, messages: Any) -> Json:
    return {"action": "send", "channel": _to(channel), "messages": [_to(channel, name) for name in messages]}


def _receives(channel: str, message: str, answers_on: str, answer: str) -> Json:
    reply = {"channel": _to(answers_on), "messages": [_to(answers_on, answer)]}
    return {"action": "receive", "channel": _to(channel), "messages": [_to(channel, message)], "reply": reply}


def _to(channel: str, message: str | None = None) -> Json:
    return {"$ref": f"#/channels/{channel}" + (f"/messages/{message}" if message else "")}


def _token(scope: str) -> list[Json]:
    scheme = {"type": "http", "scheme": "bearer", "description": f"A token with the scope {scope}."}
    return [scheme]


def _schemas() -> Json:
    wanted = [(model, "serialization") for model in _MODELS]
    template = "#/components/schemas/{model}"
    schemas: Json = models_json_schema(wanted, ref_template=template)[1]["$defs"]  # type: ignore[arg-type]
    return schemas
