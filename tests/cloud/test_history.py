"""A day played again."""

import gzip
import json

import httpx
import numpy as np
import pytest
from serving import assert_problem, running
from street import Street

from autowaze.cloud.api.spot_book import BelievedSpots, FadingStates
from autowaze.cloud.api.spot_collection import FixedTexts
from autowaze.cloud.api.spot_sheet import SpotSheet
from autowaze.world.parking import Occupancy, SpotState


@pytest.fixture
def day(tmp_path, passes, diffs):
    """Three diffs at 1000, 1100 and 1200 seconds."""
    received = iter([1010.0, 1110.0, 1210.0, 1310.0])
    now = [1000.0]
    with running(tmp_path / "cloud.db", received=lambda: now[0]) as site:
        for payload in (*passes[:2], passes[len(diffs)]):
            now[0] = next(received)
            assert site.hand_in(payload).status_code == 202
        yield site


def states(response):
    assert response.status_code == 200, response.text
    return {f["id"]: f["properties"] for f in response.json()["features"]}


def test_every_change_is_told_page_by_page(day):
    everything = day.client.get("/history").json()
    assert everything["next"] is None
    changes = everything["changes"]
    assert [change["number"] for change in changes] == sorted(change["number"] for change in changes)
    assert {change["received_at"] for change in changes} == {1010.0, 1110.0, 1210.0}
    paged, after = [], 0
    while after is not None:
        page = day.client.get("/history", params={"limit": 3, "after": after}).json()
        assert len(page["changes"]) <= 3
        paged += page["changes"]
        after = page["next"]
    assert paged == changes
    some = day.client.get("/history?start=1100&end=1120").json()["changes"]
    assert some == [change for change in changes if change["received_at"] == 1110.0] != []


def test_the_changes_lead_to_the_spots_of_any_time(day):
    changes = day.client.get("/history").json()["changes"]
    assert day.client.get("/history/extent").json() == {"start": 1010.0, "end": 1210.0}
    for at in (1000.0, 1010.0, 1150.0, 1210.0, 1500.0):
        played = {change["spot_id"]: change for change in changes if change["received_at"] <= at}
        for spot_id, spot in states(day.client.get(f"/spots.geojson?at={at}")).items():
            known = played.get(spot_id)
            assert spot["observed_at"] == (known and known["observed_at"])
            assert (spot["state"] == "unknown") == (known is None or known["state"] == "unknown")
            if known is not None:
                assert spot["age_s"] == pytest.approx(max(at - spot["observed_at"], 0.0), abs=0.06)
    assert day.client.get("/spots.geojson?at=1100").json()["map_version"] is None


def test_a_state_of_the_past_had_faded_as_far_as_it_had_then(day):
    long_after = states(day.client.get(f"/spots.geojson?at={1210 + 6 * 3600}"))
    assert {spot["state"] for spot in long_after.values()} == {"unknown"}


def test_a_service_without_history_says_so(site):
    assert site.client.get("/history").json() == {"changes": [], "next": None}
    assert site.client.get("/history/extent").json() == {"start": None, "end": None}


@pytest.mark.parametrize(
    "path",
    [
        *(
            "/history?start=2&end=1",
            "/history?limit=0",
            "/history?limit=10001",
            "/history?start=nan",
            "/history?after=-1",
        ),
        *("/history?end=1e300", f"/history?after={1 << 70}", "/spots.geojson?at=-1", "/spots.geojson?at=inf"),
    ],
)
def test_a_wrong_question_is_answered_with_400(site, path):
    assert_problem(site.client.get(path), 400, "bad_parameter")


def test_only_spots_in_a_box_are_sent_if_one_is_asked_for(day):
    features = day.client.get("/spots.geojson").json()["features"]
    lons, lats = zip(*features[4]["geometry"]["coordinates"][0], strict=True)
    shrunk = f"{min(lons) + 2e-5},{min(lats) + 2e-5},{max(lons) - 2e-5},{max(lats) - 2e-5}"
    for query in (f"bbox={shrunk}", f"bbox={shrunk}&at=1100"):
        assert "S4" in states(day.client.get(f"/spots.geojson?{query}"))
        assert len(states(day.client.get(f"/spots.geojson?{query}"))) < 4
    assert states(day.client.get("/spots.geojson?bbox=1,1,2,2")) == {}
    assert_problem(day.client.get("/spots.geojson?bbox=1,1,2"), 400, "bad_parameter")


def test_all_spots_are_written_once_for_all_and_packed(day, passes, diffs):
    with httpx.stream("GET", f"{day.url}/spots.geojson", headers={"Accept-Encoding": "gzip"}) as packed:
        body = b"".join(packed.iter_raw())
    assert packed.headers["Content-Encoding"] == "gzip"
    plain = day.client.get("/spots.geojson", headers={"Accept-Encoding": "identity"})
    assert "Content-Encoding" not in plain.headers
    assert gzip.decompress(body) == plain.content
    before = plain.json()
    day.hand_in(passes[len(diffs) + 1])
    after = day.client.get("/spots.geojson").json()
    assert after["map_version"] == before["map_version"] + 1
    day.now += 60.0
    aged = day.client.get("/spots.geojson").json()["features"][0]["properties"]["age_s"]
    assert aged == after["features"][0]["properties"]["age_s"] + 60.0


def test_many_spots_are_written_as_few_are():
    states = [SpotState("S0", Occupancy.VACANT, 0.912345, 1000.25), SpotState("S1", Occupancy.UNKNOWN)]
    states += [SpotState("S2", Occupancy.OCCUPIED, 0.02, 1999.0), SpotState("S3", Occupancy.VACANT, 0.7, 100.0)]
    sheet = SpotSheet(Street(count=4).parking_map)
    texts, rows = FixedTexts(), np.array([0, 1, 2, 3])
    for now, fades in ((2000.0, True), (90_000.0, True), (500.0, False)):
        believed = BelievedSpots(FadingStates(states, now, fades), now, 7, sheet)
        document = json.loads(texts.written(believed, rows, 7))
        assert document["features"] == [believed.feature(row) for row in range(4)]
        assert json.loads(texts.written(believed, rows[2:3], None))["features"] == [believed.feature(2)]
        assert document["map_version"] == 7


def test_a_day_of_long_ago_is_played_at_its_own_time(tmp_path, payloads):
    with running(tmp_path / "cloud.db") as site:
        for payload in payloads:
            site.hand_in(payload)
    with running(tmp_path / "cloud.db", replays=True) as site:
        shown = states(site.client.get("/spots.geojson?at=1e9"))
        assert {spot["state"] for spot in shown.values()} == {"vacant", "occupied"}
