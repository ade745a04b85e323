"""What clients read: spots, map, changes, figures."""

import json

import httpx
import numpy as np
import pytest
from serving import assert_problem, running
from websockets.sync.client import connect

from autowaze.cloud.service import CloudService
from autowaze.world.wire import decode_map, decode_map_update


def drive_by(site, payloads):
    for payload in payloads:
        response = site.hand_in(payload)
        assert response.status_code == 202, response.text


def test_vacant_is_the_thesis_rectangles(site, payloads):
    assert site.client.get("/vacant").json() == []
    drive_by(site, payloads)
    alone = CloudService(site.street.parking_map)
    for payload in payloads:
        alone.receive(payload)
    assert site.client.get("/vacant").json() == alone.vacant()
    assert len(alone.vacant()) > 5


def test_spots_say_how_sure_and_how_old_they_are(site, payloads):
    drive_by(site, payloads)
    response = site.client.get("/spots.geojson")
    assert response.headers["Content-Type"] == "application/geo+json"
    features = response.json()["features"]
    properties = {feature["id"]: feature["properties"] for feature in features}
    assert [properties[f"S{i}"]["state"] for i in range(3)] == ["occupied", "vacant", "occupied"]
    assert properties["S1"]["probability"] > 0.7  # a quarter of an hour ago
    assert properties["S1"]["age_s"] == pytest.approx(site.now - properties["S1"]["observed_at"])
    ring = np.array(features[0]["geometry"]["coordinates"][0])
    assert (ring[0] == ring[-1]).all()
    assert np.allclose(ring, [-73.0, 40.0], atol=0.001)
    edges = np.diff(ring, axis=0)
    assert (ring[:-1, 0] * edges[:, 1] - ring[:-1, 1] * edges[:, 0]).sum() > 0  # RFC 7946: counterclockwise


def test_what_nobody_looked_at_for_long_is_unknown_again(site, payloads):
    drive_by(site, payloads)
    site.now += 6 * 3600
    states = {f["properties"]["state"] for f in site.client.get("/spots.geojson").json()["features"]}
    assert states == {"unknown"}
    assert site.client.get("/vacant").json() == []


def test_a_car_follows_the_map_by_updates(site, payloads):
    first = site.client.get("/map")
    assert len(decode_map(first.content)) == 0
    assert decode_map(first.content).georeference == site.street.parking_map.georeference
    drive_by(site, payloads)
    update = decode_map_update(site.client.get("/map/updates", params={"since": 0}).content)
    followed = update.applied_to(decode_map(first.content))
    whole = site.client.get("/map")
    assert whole.headers["ETag"] == f'"{len(payloads)}"'
    assert followed.features.id.tolist() == decode_map(whole.content).features.id.tolist()
    assert site.client.get("/map", headers={"If-None-Match": whole.headers["ETag"]}).status_code == 304
    assert_problem(site.client.get("/map/updates", params={"since": 99}), 410, "map_outdated")
    for wrong in ("-1", "x", str(1 << 70), ""):
        assert_problem(site.client.get("/map/updates", params={"since": wrong}), 400, "bad_parameter")


def server_sent(lines):
    """Events (id, kind, data) of a text/event-stream."""
    fields = {}
    for line in lines:
        if line:
            name, _, value = line.partition(": ")
            fields[name] = value
        elif "data" in fields:
            yield int(fields["id"]), fields["event"], json.loads(fields["data"])
            fields = {}


def test_changes_arrive_as_they_happen_and_resume_after_a_gap(site, payloads):
    with site.client.stream("GET", "/changes") as stream:
        events = server_sent(stream.iter_lines())
        assert next(events) == (0, "current", {})
        site.hand_in(payloads[0])
        version, kind, data = next(events)
        assert (version, kind) == (1, "spots")
        assert {spot["spot_id"] for spot in data["spots"]} <= set(site.durable.service.spots.ids)
    drive_by(site, payloads[1:])
    with site.client.stream("GET", "/changes", headers={"Last-Event-ID": str(version)}) as stream:
        assert next(server_sent(stream.iter_lines()))[0] == 2
    with site.client.stream("GET", "/changes", params={"since": 77}) as stream:
        assert next(server_sent(stream.iter_lines()))[1] == "reset"


def test_changes_come_over_a_web_socket_too(site, payloads):
    with connect(site.url.replace("http", "ws") + "/changes/ws") as web_socket:
        assert json.loads(web_socket.recv(5))["event"] == "current"
        web_socket.send("what a client says is ignored")
        site.hand_in(payloads[0])
        message = json.loads(web_socket.recv(5))
        assert (message["event"], message["version"]) == ("spots", 1)
        assert {"spot_id", "state", "probability_vacant", "observed_at"} == set(message["data"]["spots"][0])


def test_a_listener_does_not_keep_the_service_from_stopping(tmp_path, payloads):
    with running(tmp_path / "cloud.db") as site, httpx.stream("GET", f"{site.url}/changes", timeout=10) as stream:
        lines = stream.iter_lines()
        assert next(lines) == "id: 0"


def test_figures_are_in_prometheus_format(site, payloads):
    site.hand_in(payloads[0])
    site.hand_in(payloads[0])
    site.hand_in(b"nonsense")
    response = site.client.get("/metrics")
    assert response.headers["Content-Type"].startswith("text/plain; version=0.0.4")
    values = dict(line.rsplit(" ", 1) for line in response.text.splitlines() if not line.startswith("#"))
    results = [values[f'autowaze_diffs_total{{result="{r}"}}'] for r in ("accepted", "repeated", "refused")]
    assert results == ["1", "1", "1"]
    assert values["autowaze_diff_delay_seconds_count"] == values['autowaze_diff_delay_seconds_bucket{le="+Inf"}'] == "2"
    assert 0 < float(values['autowaze_stage_seconds{stage="occupancy",quantile="0.5"}']) < 5
    assert float(values["autowaze_map_version"]) == 1


def test_a_healthy_service_says_so(site):
    assert site.client.get("/health").json()["status"] == "ok"
    assert site.client.get("/ready").status_code == 200


def test_every_answer_carries_security_headers(site):
    for path in ("/health", "/nowhere", "/spots.geojson"):
        headers = site.client.get(path, headers={"Origin": "https://city.example"}).headers
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert headers["Access-Control-Allow-Origin"] == "*"
        assert "server" not in headers
    preflight = {"Origin": "https://city.example", "Access-Control-Request-Method": "POST"}
    assert site.client.options("/v1/diffs", headers=preflight).status_code == 400


def test_only_pages_of_named_origins_may_read_and_none_may_hand_in(tmp_path, payloads):
    with running(tmp_path / "cloud.db", origins=["https://city.example"]) as site:
        for origin, allowed in (("https://city.example", "https://city.example"), ("https://evil.example", None)):
            headers = site.client.get("/spots.geojson", headers={"Origin": origin}).headers
            assert headers.get("Access-Control-Allow-Origin") == allowed
            assert "Access-Control-Allow-Credentials" not in headers
            preflight = {"Origin": origin, "Access-Control-Request-Method": "POST"}
            assert site.client.options("/v1/diffs", headers=preflight).status_code == 400
        by_car = site.hand_in(payloads[0])
        by_page = site.hand_in(payloads[0], Origin="https://city.example")
        assert by_page.headers["Access-Control-Allow-Origin"] == "https://city.example"
        for answer in (by_car, by_page, site.hand_in(b"nonsense")):
            assert answer.headers["Content-Security-Policy"] == "default-src 'none'; frame-ancestors 'none'"
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
            assert answer.headers["Content-Type"] == "application/json"


def test_the_interface_is_documented(site):
    document = site.client.get("/openapi.json").json()
    assert {"/v1/diffs", "/vacant", "/spots.geojson", "/map", "/map/updates", "/changes"} <= set(document["paths"])
    for path, operations in document["paths"].items():
        for operation in operations.values():
            assert operation.get("description"), path


def test_spots_are_read_page_by_page_as_qgis_does(site, payloads):
    drive_by(site, payloads)
    root = site.client.get("/").json()
    data = next(link["href"] for link in root["links"] if link["rel"] == "data")
    collection = site.client.get(data).json()["collections"][0]
    url = next(link["href"] for link in collection["links"] if link["rel"] == "items") + "?limit=5"
    seen, pages = [], 0
    while url:
        page = site.client.get(url).json()
        assert page["numberMatched"] == 12
        assert page["numberReturned"] == len(page["features"]) <= 5
        seen += [feature["id"] for feature in page["features"]]
        pages += 1
        url = next((link["href"] for link in page["links"] if link["rel"] == "next"), None)
    assert (pages, seen) == (3, [f"S{i}" for i in range(12)])
    west, south, east, north = collection["extent"]["spatial"]["bbox"][0]
    everything = site.client.get("/collections/spots/items", params={"bbox": f"{west},{south},{east},{north}"})
    assert everything.json()["numberMatched"] == 12
    assert site.client.get("/collections/spots/items?bbox=1,1,2,2").json()["numberMatched"] == 0
    assert site.client.get("/collections/spots/items/S3").json()["properties"]["kind"] == "unknown"
    assert any(part.endswith("/core") for part in site.client.get("/conformance").json()["conformsTo"])


def test_a_client_may_ask_for_more_than_it_gets(site, payloads):
    """As QGIS does: ten first, to learn the fields, then pages as long as the service has them, to the last."""
    drive_by(site, payloads)
    assert site.client.get("/collections/spots/items?limit=10").json()["numberReturned"] == 10
    page = site.client.get("/collections/spots/items?limit=100000000000").json()
    assert page["numberReturned"] == page["numberMatched"] == 12
    assert [link["rel"] for link in page["links"]] == ["self"]
    routes = site.client.get("/openapi.json").json()["paths"]
    parameters = {p["name"]: p for p in routes["/collections/spots/items"]["get"]["parameters"]}
    assert parameters["limit"]["schema"]["maximum"] == 1000
    json_page = site.client.get("/", params={"f": "json"}, headers={"Accept": "text/html"})
    assert {"service-desc", "conformance", "data"} <= {link["rel"] for link in json_page.json()["links"]}


def test_pages_of_a_box_lead_on_within_the_box(site, payloads):
    drive_by(site, payloads)
    url = "/collections/spots/items?limit=2&bbox=-73.1,39.9,-72.9,40.1&datetime=1970-01-01T00:00:00Z/.."
    seen = []
    while url:
        page = site.client.get(url).json()
        seen += [feature["id"] for feature in page["features"]]
        url = next((link["href"] for link in page["links"] if link["rel"] == "next"), None)
    assert seen == [f"S{i}" for i in range(12)]


def test_spots_may_be_chosen_by_when_they_were_seen(site, payloads):
    drive_by(site, payloads)

    def count(interval):
        return site.client.get("/collections/spots/items", params={"datetime": interval}).json()["numberMatched"]

    assert count("1970-01-01T00:16:40Z/..") == 12
    assert count("../1970-01-01T00:00:01Z") == 0
    assert count("1970-01-01T00:00:00Z/1970-01-02T00:00:00Z") == 12


@pytest.mark.parametrize(
    "query",
    [
        *(
            "limit=0",
            "limit=x",
            "offset=-1",
            "limits=5",
            "bbox=1,2,3",
            "bbox=a,b,c,d",
            "bbox=1,9,2,3",
            "bbox=nan,1,2,3",
        ),
        *("datetime=yesterday", "datetime=2026-01-02T00:00:00Z/2026-01-01T00:00:00Z", "datetime=..%2F.."),
    ],
)
def test_a_wrong_question_about_items_is_answered_with_400(site, query):
    assert_problem(site.client.get(f"/collections/spots/items?{query}"), 400, "bad_parameter")


def test_an_unknown_spot_is_not_found(site):
    assert_problem(site.client.get("/collections/spots/items/S99"), 404, "not_found")
