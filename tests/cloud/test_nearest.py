"""Where to park."""

import numpy as np
import pytest
from serving import STREET, assert_problem, running
from shapely import LineString, Point
from street import GEOREFERENCE

from autowaze.cloud.belief import DWELL_S, faded_probability
from autowaze.cloud.nearest import SEARCH_S, SpotFinder
from autowaze.cloud.routing import WALKING_MPS, TravelMode
from autowaze.world.streets import StreetNetwork, streets

LANE = LineString([tuple(STREET.along * d) for d in (-50.0, 0.0, STREET.length + 50.0)])


@pytest.fixture(scope="module")
def lane(tmp_path_factory, payloads):
    """Spots 0, 2, 5 and 9 are taken; the others were seen vacant a quarter of an hour ago."""
    network = StreetNetwork(GEOREFERENCE, streets([LANE], ["Lane"]))
    with running(tmp_path_factory.mktemp("lane") / "cloud.db", streets=network) as site:
        for payload in payloads:
            assert site.hand_in(payload).status_code == 202
        yield site


def lon_lat(point):
    lon, lat = GEOREFERENCE.to_lon_lat(np.array([point]))[0]
    return {"lon": lon, "lat": lat}


def asked(site, point, **parameters):
    response = site.client.get("/nearest", params={**lon_lat(point), **parameters})
    assert response.status_code == 200, response.text
    return response.json()


def test_the_nearest_vacant_spots_come_with_a_way_along_the_street(lane):
    answer = asked(lane, STREET.centre(5), limit=4)
    assert answer["routed"]
    assert {spot["spot_id"] for spot in answer["spots"]} == {"S3", "S4", "S6", "S7"}
    spot = next(spot for spot in answer["spots"] if spot["spot_id"] == "S4")
    assert spot["distance_m"] == pytest.approx(3.6 + 6.0 + 3.6, abs=0.1)  # to the lane, along it, and back
    assert spot["duration_s"] == pytest.approx(spot["distance_m"] / WALKING_MPS, abs=0.1)
    route = GEOREFERENCE.to_map(np.array(spot["route"]["coordinates"]))[:, :2]
    assert np.allclose(route[[0, -1]], [STREET.centre(5), STREET.centre(4)], atol=0.05)
    assert max(LANE.distance(point) for point in map(Point, route[1:-1])) < 0.05
    assert (spot["lon"], spot["lat"]) == tuple(spot["route"]["coordinates"][-1])


def test_the_chance_is_that_of_the_belief_faded_over_age_and_way(lane):
    shown = {f["id"]: f["properties"] for f in lane.client.get("/spots.geojson").json()["features"]}
    for spot in asked(lane, STREET.centre(0), limit=50)["spots"]:
        now = shown[spot["spot_id"]]["probability"]
        assert spot["probability_vacant"] == pytest.approx(now, abs=1e-4)
        assert spot["observed_at"] == shown[spot["spot_id"]]["observed_at"]
        then = 0.5 + (now - 0.5) * np.exp(-2 * spot["duration_s"] / DWELL_S)
        assert spot["probability_on_arrival"] == pytest.approx(then, abs=2e-4)
        assert spot["expected_s"] == pytest.approx(spot["duration_s"] + (1 - then) * SEARCH_S, abs=0.2)
        assert shown[spot["spot_id"]]["state"] == "vacant"


def test_one_drives_faster_but_not_against_the_street(lane):
    near, far = STREET.along * 0.0, STREET.centre(11)
    walked = {s["spot_id"]: s for s in asked(lane, far, limit=50)["spots"]}
    driven = {s["spot_id"]: s for s in asked(lane, far, limit=50, mode="driving")["spots"]}
    assert set(walked) == set(driven)
    assert driven["S1"]["distance_m"] == pytest.approx(walked["S1"]["distance_m"], abs=0.2)
    assert driven["S1"]["duration_s"] < walked["S1"]["duration_s"] / 3
    assert asked(lane, near, limit=1)["spots"][0]["spot_id"] == "S1"


def test_far_from_everything_there_is_nothing(lane):
    assert asked(lane, (50_000.0, 0.0))["spots"] == []
    assert lane.client.get("/nearest?lon=107&lat=-40").json()["spots"] == []


def test_without_streets_one_goes_as_the_crow_flies(site, payloads):
    for payload in payloads:
        site.hand_in(payload)
    answer = asked(site, STREET.centre(5), limit=2)
    assert not answer["routed"]
    assert {spot["spot_id"] for spot in answer["spots"]} == {"S4", "S6"}
    assert answer["spots"][0]["distance_m"] == pytest.approx(6.0, abs=0.05)
    assert len(answer["spots"][0]["route"]["coordinates"]) == 2


@pytest.mark.parametrize(
    "query",
    [
        *("lat=40", "lon=181&lat=40", "lon=nan&lat=40", "lon=inf&lat=0", "lon=1&lat=91", "lon=x&lat=40"),
        *("lon=1&lat=1&limit=0", "lon=1&lat=1&limit=51", "lon=1&lat=1&mode=flying"),
    ],
)
def test_a_wrong_question_is_answered_with_400(lane, query):
    assert_problem(lane.client.get(f"/nearest?{query}"), 400, "bad_parameter")


def test_no_better_spot_is_missed_in_a_city():
    """On a grid of footways so dense that ways are straight east and north, against all spots one by one."""
    rng = np.random.default_rng(5)
    ticks = range(0, 2001, 50)
    lines = [LineString([(x, y) for y in ticks]) for x in ticks] + [LineString([(x, y) for x in ticks]) for y in ticks]
    finder = SpotFinder(StreetNetwork(GEOREFERENCE, streets(lines)))
    centre = rng.uniform(0, 40, (20_000, 2)).round() * 50.0  # on crossings
    vacant = np.where(rng.random(20_000) < 0.02, rng.uniform(0.6, 0.99, 20_000), rng.uniform(0, 0.4, 20_000))
    spots = finder.place(centre)
    for _ in range(10):
        point = rng.integers(0, 41, 2) * 50.0
        routed, found = finder.nearest(point, TravelMode.WALKING, 5, spots, lambda rows: vacant[rows])
        assert routed
        duration = np.abs(centre - point).sum(axis=1) / WALKING_MPS
        expected = duration + (1 - faded_probability(vacant, duration)) * SEARCH_S
        best = np.sort(np.where(vacant >= 0.6, expected, np.inf))[:5]
        assert [choice.expected_s for choice in found] == pytest.approx(best.tolist())
        for choice in found:
            assert choice.distance_m == pytest.approx(np.abs(centre[choice.row] - point).sum())
