"""The spots around a car come down to it, and others as it drives on."""

from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from serving import running
from street import GEOREFERENCE

from autowaze.vehicle.connection import CloudConnection
from autowaze.vehicle.ground_grid import ground_that_matters
from autowaze.vehicle.spot_follower import FETCHED_ANEW_AFTER_M, SpotFollower, fetch_spots
from autowaze.world.parking import ParkingMap, ParkingSpot

EASTINGS = (0.0, 100.0, 900.0, 5000.0)


@dataclass(frozen=True)
class Drawn:
    """A street of which there is the parking map only."""

    parking_map: ParkingMap


def spots():
    outlines = [shapely.box(x - 1, -2.5, x + 1, 2.5) for x in EASTINGS]
    return ParkingMap(tuple(ParkingSpot(f"S{n}", outline) for n, outline in enumerate(outlines)), GEOREFERENCE)


@pytest.fixture
def connection(tmp_path):
    with running(tmp_path / "cloud.db", street=Drawn(spots())) as site, CloudConnection(site.url) as connection:
        yield connection


def test_a_car_learns_of_the_spots_around_it_as_it_drives(connection):
    follower = SpotFollower(connection, GEOREFERENCE)
    assert list(follower.follow(np.zeros(3)).by_id) == ["S0", "S1"]
    assert follower.follow(np.array([FETCHED_ANEW_AFTER_M - 1, 0, 0])) is None
    assert list(follower.follow(np.array([450.0, 0, 0])).by_id) == ["S0", "S1", "S2"]
    assert len(follower.follow(np.array([2500.0, 0, 0]))) == 0
    assert list(fetch_spots(connection).by_id) == ["S0", "S1", "S2", "S3"]


def test_a_box_that_is_none_is_refused(connection):
    assert connection.get("/parking_map.geojson?bbox=1,2,3", 1000).status == 400


def test_no_spots_around_is_no_ground_to_tell_of(connection):
    follower = SpotFollower(connection, GEOREFERENCE)
    asked = np.array([[100.0, 0.0], [50.0, 50.0], [900.0, 0.0]])
    places = {0.0: [True, False, False], 900.0: [False, False, True], 2500.0: [False] * 3}
    for place, told in places.items():
        area = ground_that_matters(follower.follow(np.array([place, 0, 0])))
        assert shapely.contains_xy(area, *asked.T).tolist() == told
