"""The Curb Data Specification 1.1, checked against models written from its text."""

from typing import Annotated, Literal
from uuid import UUID

import pytest
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter
from serving import STREET, assert_problem, running
from shapely.geometry import shape

from autowaze.world.wire import encode_diff

Milliseconds = Annotated[int, Field(ge=0)]
Centimetres = Annotated[int, Field(ge=0)]


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Links(Strict):
    next: str | None


class Envelope(Strict):
    version: Literal["1.1.0"]
    time_zone: str
    last_updated: Milliseconds
    currency: str | None
    author: str
    license_url: str | None
    data: dict[str, list[dict] | dict]
    links: Links


class Polygon(Strict):
    type: Literal["Polygon"]
    coordinates: list[list[list[float]]]


class Point(Strict):
    type: Literal["Point"]
    coordinates: list[float]


class CurbZone(Strict):
    curb_zone_id: Annotated[UUID, Field(strict=False)]
    geometry: Polygon
    curb_policy_ids: list[str]
    published_date: Milliseconds
    last_updated_date: Milliseconds
    start_date: Milliseconds
    parking_angle: Literal["parallel", "perpendicular", "angled"] | None = None
    length: Centimetres
    width: Centimetres
    num_spaces: int
    available_spaces: int | None = None
    available_space_lengths: list[Centimetres] | None = None
    availability_time: Milliseconds | None = None
    curb_space_ids: list[str]
    custom_attributes: dict[str, str] = {}


class CurbSpace(Strict):
    curb_space_id: Annotated[UUID, Field(strict=False)]
    geometry: Polygon
    published_date: Milliseconds
    last_updated_date: Milliseconds
    curb_zone_id: Annotated[UUID, Field(strict=False)]
    space_number: int
    length: Centimetres
    width: Centimetres
    available: bool | None = None
    availability_time: Milliseconds | None = None
    custom_attributes: dict[str, str]


class CurbEvent(Strict):
    event_id: Annotated[UUID, Field(strict=False)]
    event_type: Literal["scheduled_report", "park_start", "park_end"]
    event_location: Point
    event_time: Milliseconds
    event_publication_time: Milliseconds
    curb_zone_id: Annotated[UUID, Field(strict=False)]
    curb_space_id: Annotated[UUID, Field(strict=False)]
    data_source_type: Literal["camera"]
    data_source_device_id: Annotated[UUID, Field(strict=False)]
    custom_attributes: dict[str, str]


MODEL = {"zones": CurbZone, "spaces": CurbSpace, "events": CurbEvent}


def asked(site, path, **parameters):
    """The validated documents of one page."""
    response = site.client.get(f"/cds/{path}", params=parameters)
    assert response.status_code == 200, response.text
    assert response.headers["Content-Type"] == "application/vnd.cds+json;version=1.1"
    envelope = Envelope.model_validate_json(response.content)
    (name, documents), *_ = envelope.data.items()
    TypeAdapter(list[MODEL[name]]).validate_python(documents)
    return documents


def pass_by(site, spots, session, start):
    for diff in STREET.drive(STREET.park(spots, seed=session), session=session, start=start):
        assert site.hand_in(encode_diff(diff)).status_code == 202


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """A site where two cars passed, a quarter of an hour apart: one parked car left, another came."""
    with running(tmp_path_factory.mktemp("cds") / "cloud.db") as site:
        pass_by(site, [0, 2, 5], session=1, start=1000.0)
        pass_by(site, [0, 5, 8], session=2, start=1900.0)
        site.now = 2100.0
        yield site


def test_spaces_say_whether_they_are_free_how_sure_and_how_old(seen):
    spaces = {space["custom_attributes"]["spot_id"]: space for space in asked(seen, "curbs/spaces")}
    assert (spaces["S0"]["available"], spaces["S1"]["available"]) == (False, True)
    assert float(spaces["S1"]["custom_attributes"]["probability"]) > 0.6
    assert 0 < int(spaces["S1"]["custom_attributes"]["observed_age_s"]) < 300
    assert spaces["S0"]["length"] == 600


def test_a_space_lies_in_its_zone(seen):
    zones = {zone["curb_zone_id"]: zone for zone in asked(seen, "curbs/zones")}
    spaces = asked(seen, "curbs/spaces")
    for space in spaces:
        zone = zones[space["curb_zone_id"]]
        assert space["curb_space_id"] in zone["curb_space_ids"]
        assert shape(zone["geometry"]).contains(shape(space["geometry"]))
    zone = next(iter(zones.values()))
    assert zone["num_spaces"] == len(spaces) == 12
    assert zone["available_spaces"] == sum(space.get("available", False) for space in spaces)


def test_what_nobody_saw_is_neither_free_nor_taken(tmp_path):
    with running(tmp_path / "cloud.db") as site:
        assert all("available" not in space for space in asked(site, "curbs/spaces"))
        assert all("available_spaces" not in zone for zone in asked(site, "curbs/zones"))
        assert asked(site, "events/events") == []


def test_passes_that_bracket_a_change_tell_a_start_and_an_end(seen):
    space = {s["custom_attributes"]["spot_id"]: s["curb_space_id"] for s in asked(seen, "curbs/spaces")}
    events = asked(seen, "events/events")
    kinds = {name: [e["event_type"] for e in events if e["curb_space_id"] == space[name]] for name in space}
    assert kinds["S2"] == ["park_end", "scheduled_report"]
    assert kinds["S8"] == ["park_start", "scheduled_report"]
    assert kinds["S0"] == ["scheduled_report", "scheduled_report"]
    end = next(e for e in events if e["event_type"] == "park_end")
    bracket = [int(end["custom_attributes"][name]) for name in ("not_before_ms", "not_after_ms")]
    assert 1_000_000 < bracket[0] < 1_100_000 < 1_900_000 < bracket[1] == end["event_time"]
    assert "event_session_id" not in end


def test_a_restarted_service_tells_the_same_events(tmp_path):
    with running(tmp_path / "cloud.db") as site:
        pass_by(site, [0, 2], session=1, start=1000.0)
        pass_by(site, [0], session=2, start=1900.0)
        site.now = 2100.0
        before = asked(site, "events/events")
    with running(tmp_path / "cloud.db") as site:
        site.now = 2100.0
        assert asked(site, "events/events") == before != []


def test_events_are_chosen_by_place_and_hour(seen):
    events = asked(seen, "events/events")
    space_id = events[0]["curb_space_id"]
    assert {e["curb_space_id"] for e in asked(seen, "events/events", curb_space_id=space_id)} == {space_id}
    assert asked(seen, "events/events", curb_zone_id=events[0]["curb_zone_id"]) == events
    assert asked(seen, "events/events", event_time="1970-01-01T00") == events
    assert asked(seen, "events/events", event_time="1970-01-01T01") == []


def test_events_come_newest_first_and_page_by_page(seen, monkeypatch):
    events = asked(seen, "events/events")
    monkeypatch.setattr("autowaze.cloud.api.cds.MOST_AT_ONCE", 5)
    paged, url = [], f"{seen.url}/cds/events/events"
    while url:
        page = seen.client.get(url).json()
        paged += page["data"]["events"]
        url = page["links"]["next"]
    assert paged == events
    assert events[0]["event_time"] > events[-1]["event_time"]


def test_curbs_are_chosen_by_place(seen):
    spaces = {space["custom_attributes"]["spot_id"]: space for space in asked(seen, "curbs/spaces")}
    lng, lat = shape(spaces["S4"]["geometry"]).centroid.coords[0]
    near = asked(seen, "curbs/spaces", lat=lat, lng=lng, radius=500)
    assert near[0] == spaces["S4"]
    assert len(near) == 3
    west, south, east, north = shape(spaces["S4"]["geometry"]).buffer(-1e-6).bounds
    box = {"min_lng": west, "min_lat": south, "max_lng": east, "max_lat": north}
    assert "S4" in [space["custom_attributes"]["spot_id"] for space in asked(seen, "curbs/spaces", **box)]
    assert asked(seen, "curbs/zones", min_lng=1, min_lat=1, max_lng=2, max_lat=2) == []
    assert len(asked(seen, "curbs/spaces", min_lng=-180, min_lat=-90, max_lng=180, max_lat=90)) == 12
    assert asked(seen, "events/events", min_lng=1, min_lat=1, max_lng=2, max_lat=2) == []
    assert asked(seen, "curbs/zones", time=400_000) == []
    assert len(asked(seen, "curbs/zones", time=600_000)) == 1


def test_one_zone_and_one_space_by_id(seen):
    space = asked(seen, "curbs/spaces")[3]
    alone = seen.client.get(f"/cds/curbs/spaces/{space['curb_space_id']}").json()
    assert alone["data"]["space"] == space
    assert seen.client.get(f"/cds/curbs/zones/{space['curb_zone_id']}").status_code == 200
    assert_problem(seen.client.get("/cds/curbs/zones/none"), 404, "not_found")


def test_another_version_is_not_acceptable(seen):
    def accepting(kind):
        return seen.client.get("/cds/curbs/zones", headers={"Accept": kind})

    assert accepting("application/vnd.cds+json;version=1.1").status_code == 200
    assert accepting("application/vnd.cds+json;version=1.0, application/vnd.cds+json;version=1.1").status_code == 200
    assert_problem(accepting("application/vnd.cds+json;version=2.0"), 406, "not_acceptable")


@pytest.mark.parametrize("path", ["curbs/areas", "curbs/policies", "events/status", "metrics/sessions"])
def test_what_is_not_offered_says_so(seen, path):
    assert_problem(seen.client.get(f"/cds/{path}"), 501, "not_implemented")


@pytest.mark.parametrize(
    "query", ["min_lat=1", "lat=1&lng=1", "lat=nan&lng=1&radius=5", "lat=91&lng=1&radius=5", "lat=1&lng=1&radius=-1"]
)
def test_half_a_place_is_refused(seen, query):
    assert_problem(seen.client.get(f"/cds/curbs/spaces?{query}"), 400, "bad_parameter")
    assert_problem(seen.client.get("/cds/events/events?event_time=today"), 400, "bad_parameter")
