"""The AsyncAPI document, against a schema written from the text of AsyncAPI 3.0, and real messages against it."""

import json

import jsonschema_rs
import pytest
from websockets.sync.client import connect

from autowaze.cloud.api.asyncapi import asyncapi_document
from autowaze.world.acknowledgement import Acknowledgement, Verdict
from autowaze.world.broker import BrokerAddress, acks_topic, diffs_topic, map_topic, spots_topic
from autowaze.world.tiles import TILE_ZOOM

REFERENCE = {"type": "object", "required": ["$ref"], "properties": {"$ref": {"type": "string", "pattern": "^#/"}}}


def named(pattern, value):
    """A map whose keys follow a pattern."""
    return {"type": "object", "patternProperties": {pattern: value}, "additionalProperties": False}


def closed(required, **properties):
    """An object with these members, and extensions."""
    return {
        "type": "object",
        "required": required,
        "properties": properties,
        "patternProperties": {"^x-": {}},
        "additionalProperties": False,
    }


TEXT, REFERENCES = {"type": "string"}, {"type": "array", "items": REFERENCE}
MESSAGE = closed([], summary=TEXT, contentType=TEXT, payload={"type": "object"})
CHANNEL = closed(
    [],
    address={"type": "string", "not": {"pattern": "[?#]"}},
    description=TEXT,
    servers=REFERENCES,
    messages=named(r"^[A-Za-z0-9_-]+$", MESSAGE),
    parameters=named(r"^[A-Za-z0-9_-]+$", closed([], description=TEXT, enum={"type": "array"})),
    bindings={"type": "object"},
)
OPERATION = closed(
    ["action", "channel"],
    action={"enum": ["send", "receive"]},
    channel=REFERENCE,
    messages=REFERENCES,
    reply=closed([], channel=REFERENCE, messages=REFERENCES),
    security={"type": "array", "items": {"type": "object", "required": ["type"]}},
    bindings={"type": "object"},
)
SERVER = closed(["host", "protocol"], host=TEXT, protocol=TEXT, protocolVersion=TEXT, description=TEXT)
ASYNCAPI = closed(
    ["asyncapi", "info"],
    asyncapi={"const": "3.0.0"},
    info=closed(["title", "version"], title=TEXT, version=TEXT, description=TEXT, license=closed(["name"], name=TEXT)),
    defaultContentType=TEXT,
    servers=named(r"^[A-Za-z0-9_-]+$", SERVER),
    channels={"type": "object", "additionalProperties": CHANNEL},
    operations={"type": "object", "additionalProperties": OPERATION},
    components=closed(
        [],
        schemas=named(r"^[A-Za-z0-9._-]+$", {"type": "object"}),
        securitySchemes=named(r"^[A-Za-z0-9._-]+$", {"type": "object", "required": ["type"]}),
    ),
)


def references(node):
    if isinstance(node, dict):
        for key, value in node.items():
            if key == "$ref":
                yield value
            else:
                yield from references(value)
    elif isinstance(node, list):
        for value in node:
            yield from references(value)


def resolved(document, reference):
    for part in reference.removeprefix("#/").split("/"):
        document = document[part]
    return document


@pytest.fixture(params=[None, BrokerAddress("broker.example", 8883, tls=True)], ids=["alone", "with a broker"])
def document(request):
    return asyncapi_document("city.example", True, request.param)


def test_the_document_is_asyncapi(document):
    jsonschema_rs.Draft7Validator(ASYNCAPI).validate(document)
    for reference in references(document):
        assert resolved(document, reference)


def test_operations_speak_of_messages_of_their_channel(document):
    told = []
    for operation in document["operations"].values():
        for part in (operation, operation.get("reply")):
            if part is not None:
                assert all(m["$ref"].startswith(part["channel"]["$ref"] + "/messages/") for m in part["messages"])
                told += [message["$ref"] for message in part["messages"]]
    channels = document["channels"].items()
    assert {f"#/channels/{name}/messages/{m}" for name, channel in channels for m in channel["messages"]} == set(told)


def test_every_parameter_of_an_address_is_described(document):
    for channel in document["channels"].values():
        names = {part[1:-1] for part in channel["address"].split("/") if part.startswith("{")}
        assert names == set(channel.get("parameters", {}))


def test_topics_are_those_of_the_broker():
    channels = asyncapi_document("x", False, BrokerAddress("broker.example", 1883))["channels"]
    addresses = {name: channel["address"] for name, channel in channels.items()}
    assert addresses["diffs"].format(car="abc") == diffs_topic("abc")
    assert addresses["acks"].format(car="abc") == acks_topic("abc")
    assert addresses["spotsOfTile"].format(x=1, y=2) == spots_topic(TILE_ZOOM, 1, 2)
    assert addresses["mapOfTile"].format(x=1, y=2) == map_topic(TILE_ZOOM, 1, 2)
    assert "broker" not in asyncapi_document("x", False, None)["servers"]


def validator(document, channel, message):
    payload = document["channels"][channel]["messages"][message]["payload"]
    return jsonschema_rs.Draft202012Validator({**payload, "components": document["components"]})


def test_what_is_sent_is_what_is_described(site, payloads):
    response = site.client.get("/asyncapi.json")
    assert response.headers["Content-Type"] == "application/vnd.aai.asyncapi+json;version=3.0.0"
    document = response.json()
    jsonschema_rs.Draft7Validator(ASYNCAPI).validate(document)
    assert document["servers"]["http"]["host"] == site.url.removeprefix("http://")
    paths = site.client.get("/openapi.json").json()["paths"]
    assert {document["channels"][name]["address"] for name in ("changes", "fleet")} <= set(paths)
    with (
        connect(site.url.replace("http", "ws") + "/changes/ws") as follower,
        connect(site.url.replace("http", "ws") + "/v1/diffs/ws") as car,
        site.client.stream("GET", "/fleet/changes") as fleet,
    ):
        lines = fleet.iter_lines()
        next(lines)
        envelope = validator(document, "changesBySocket", "change")
        envelope.validate(json.loads(follower.recv(5)))
        car.send(payloads[0])
        validator(document, "diffsBySocket", "acknowledgement").validate(json.loads(car.recv(5)))
        change = json.loads(follower.recv(5))
        envelope.validate(change)
        validator(document, "changes", change["event"]).validate(change["data"])
        assert change["data"]["spots"]
        kind = None
        for line in lines:
            name, _, value = line.partition(": ")
            kind = value if name == "event" else kind
            if name == "data":
                validator(document, "fleet", kind).validate(json.loads(value))
            if name == "data" and kind == "diff":
                break


def test_a_described_message_refuses_what_is_none(document):
    spots = validator(document, "changes", "spots")
    assert not spots.is_valid({"spots": [{"spot_id": "S1", "state": "free"}]})
    sealed = json.loads(Acknowledgement("0" * 64, Verdict.ACCEPTED, map_version=3).encode("car", b"hash"))
    validator(document, "diffsBySocket", "acknowledgement").validate(sealed)
