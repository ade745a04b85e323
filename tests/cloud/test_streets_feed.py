"""Streets for the live map."""

import gzip

import httpx
import numpy as np
import pytest
from serving import assert_problem, running
from shapely import LineString, box
from street import GEOREFERENCE

from autowaze.world.streets import StreetNetwork, buildings, streets


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    network = StreetNetwork(
        GEOREFERENCE,
        streets([LineString([(0, 0), (20, 80)]), LineString([(500, 0), (500, 80)])], ["Lane", "Far"], [True, False]),
        buildings([box(10, 10, 20, 20)], [9.0]),
    )
    with running(tmp_path_factory.mktemp("town") / "cloud.db", streets=network) as site:
        yield site


def test_streets_are_served_as_they_were_given(town):
    response = town.client.get("/streets.geojson")
    assert response.headers["Content-Type"] == "application/geo+json"
    found = StreetNetwork.from_document(response.json(), "answer", GEOREFERENCE)
    assert found.streets.name.tolist() == ["Lane", "Far"]
    assert found.streets.oneway.tolist() == [True, False]
    assert np.allclose(found.streets.line[0].coords, [(0, 0), (20, 80)], atol=0.01)
    assert found.buildings.height_m.tolist() == [9.0]


def test_only_those_in_a_box_are_served_if_one_is_asked_for(town):
    west, south, east, north = -73.0001, 39.9999, -72.999, 40.001
    features = town.client.get(f"/streets.geojson?bbox={west},{south},{east},{north}").json()["features"]
    assert [f["properties"]["kind"] for f in features] == ["street", "building"]
    assert_problem(town.client.get("/streets.geojson?bbox=1,2,3"), 400, "bad_parameter")


def test_a_client_that_has_them_is_told_so(town):
    first = town.client.get("/streets.geojson")
    again = town.client.get("/streets.geojson", headers={"If-None-Match": first.headers["ETag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_they_come_packed(town):
    with httpx.stream("GET", f"{town.url}/streets.geojson", headers={"Accept-Encoding": "gzip"}) as packed:
        body = b"".join(packed.iter_raw())
    plain = town.client.get("/streets.geojson", headers={"Accept-Encoding": "identity"})
    assert packed.headers["Content-Encoding"] == "gzip"
    assert gzip.decompress(body) == plain.content


def test_a_service_without_streets_says_so(site):
    assert_problem(site.client.get("/streets.geojson"), 404, "not_found")
