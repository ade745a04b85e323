"""What comes down to a car: the tiles around it, and nothing that cannot be true."""

import json
import threading
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from serving import running
from street import GEOREFERENCE, Street, features

from autowaze.vehicle import tile_follower
from autowaze.vehicle.connection import CloudConnection, UnreachableError
from autowaze.vehicle.downlink import LiveDownlink
from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.tile_follower import BadMapError, TileFollower, map_frame_at
from autowaze.vehicle.uplink import HttpTransport, Uplink
from autowaze.vehicle.vacant_spots import in_words, nearest_vacant
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.georeference import Georeference
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.map_update import MapUpdate
from autowaze.world.tiles import tiles_of_map
from autowaze.world.wire import encode_diff, encode_map_update

HERE, FAR = np.zeros(3), np.array([3000.0, 0.0, 0.0])
X, Y = tiles_of_map(HERE[None], GEOREFERENCE)[0].tolist()


def report(session, position, removed=()):
    """What a car says of new features at these positions (N, 3) and of features that went."""
    new = features(session, 0, position, [np.full(len(position), 1)], 1000.0)
    gone = np.sort(np.array(removed, np.uint64))
    return SemanticMapDiff(session, 0, 1000.0, 1005.0, georeference=GEOREFERENCE, new=new, removed=gone)


def around(place, count, seed=0, within_m=120.0):
    return place + np.random.default_rng(seed).uniform(-within_m, within_m, (count, 3)) * [1, 1, 0.01]


class Car:
    """A stored map that follows a service."""

    def __init__(self, connection, stored=None):
        self.map = stored or FeatureMap(georeference=GEOREFERENCE)
        self.connection = connection
        self.follower = TileFollower(self.connection, GEOREFERENCE, self.map)

    def follow(self, position=HERE):
        update = self.follower.follow(position)
        if update is not None:
            self.map = update.applied_to(self.map)
        return update

    @property
    def ids(self):
        return self.map.features.id.tolist()


@pytest.fixture
def connect():
    """Connections that are closed at the end."""
    with ExitStack() as stack:
        yield lambda url, token=None: stack.enter_context(CloudConnection(url, token, timeout_s=5))


@pytest.fixture
def car(connect):
    return lambda url, stored=None: Car(connect(url), stored)


def ids_near(site, position, radius_m=60.0):
    return site.durable.service.feature_map.near(position, radius_m).id.tolist()


def test_a_car_has_what_the_service_has_around_it_and_no_more(site, car):
    driven = car(site.url)
    assert driven.follow() is None
    near, far = report(1, around(HERE, 50)), report(2, around(FAR, 50))
    site.hand_in(encode_diff(near))
    site.hand_in(encode_diff(far))
    driven.follow()
    assert driven.ids == near.new.id.tolist()
    site.hand_in(encode_diff(report(3, around(HERE, 5, seed=1), near.new.id[:20])))
    update = driven.follow()
    assert (len(update.added), len(update.removed)) == (5, 20)
    assert driven.ids == ids_near(site, HERE, 200)
    assert driven.follow() is None
    driven.follow(FAR)
    assert driven.ids == far.new.id.tolist()
    driven.follow(HERE)
    assert driven.ids == ids_near(site, HERE, 200)


def test_after_a_gap_only_what_was_missed_comes(site, car):
    driven = car(site.url)
    site.hand_in(encode_diff(report(1, around(HERE, 300))))
    whole = driven.follow()
    for session in range(2, 30):
        site.hand_in(encode_diff(report(session, around(HERE, 2, session), whole.added.id[session : session + 1])))
    update = driven.follow()
    assert (len(update.added), len(update.removed)) == (56, 28)
    assert driven.ids == ids_near(site, HERE, 200)


def test_a_service_that_was_set_back_replaces_what_the_car_has(tmp_path, car, connect):
    with running(tmp_path / "old.db") as site:
        for session in range(1, 4):
            site.hand_in(encode_diff(report(session, around(HERE, 20, session))))
        driven = car(site.url)
        driven.follow()
    with running(tmp_path / "new.db") as site:
        site.hand_in(encode_diff(report(2, around(HERE, 20, 2))))
        driven.follower._connection = connect(site.url)
        driven.follow()
        assert driven.ids == ids_near(site, HERE, 200)


def test_what_the_service_has_takes_the_place_of_the_map_on_board(site, car):
    on_board = FeatureMap(report(77, np.vstack([around(HERE, 10), around(FAR, 10)])).new, GEOREFERENCE, 9)
    driven = car(site.url, on_board)
    site.hand_in(encode_diff(report(1, around(HERE, 20))))
    driven.follow()
    assert driven.ids == [*ids_near(site, HERE, 200), *on_board.features.id[10:].tolist()]


def test_no_more_than_the_car_can_hold(site, monkeypatch, car):
    monkeypatch.setattr(tile_follower, "MOST_FEATURES", 60)
    for session in range(1, 9):
        site.hand_in(encode_diff(report(session, around(np.array([150.0 * session - 600, 0, 0]), 20, session, 20.0))))
    driven = car(site.url)
    for x in range(-600, 600, 50):
        driven.follow(np.array([x, 0.0, 0.0]))
        assert len(driven.map) <= 60


def test_the_map_frame_is_asked_for_where_the_car_stands(site, connect):
    assert map_frame_at(connect(site.url), -73.0, 40.0) == GEOREFERENCE


def listing(version=3, **tile):
    return json.dumps({"version": version, "zoom": 17, "tiles": [{"x": X, "y": Y, "map_version": 3, **tile}]}).encode()


GOOD = MapUpdate(0, 3, report(1, around(HERE, 5, within_m=1.0)).new, np.zeros(0, np.uint64), GEOREFERENCE)
ELSEWHERE = replace(GOOD, added=report(1, around(FAR, 5)).new)
MOVED = Georeference(41.0, -73.0)
BOMB = replace(GOOD, added=report(1, np.zeros((4096, 3))).new)


@pytest.mark.parametrize(
    ("tiles", "tile"),
    [
        (b"", b""),
        (b"[" * 60_000, b""),
        (b'{"version": 1e400, "tiles": []}', b""),
        (b'{"version": true, "tiles": []}', b""),
        (b'{"version": -1, "tiles": []}', b""),
        (b'{"version": 3, "tiles": [{"x": [], "y": {}, "map_version": 1}]}', b""),
        (b'{"version": 3, "tiles": 7}', b""),
        (b"x" * (2 << 20), b""),
        (listing(map_version="9"), b""),
        (listing(map_version=1 << 70), b""),
        (listing(), b""),
        (listing(), b"x" * 1000),
        (listing(), b"x" * (17 << 20)),
        (listing(), encode_map_update(GOOD)[:-5]),
        (listing(), encode_map_update(ELSEWHERE)),
        (listing(), encode_map_update(replace(GOOD, georeference=None))),
        (listing(), encode_map_update(replace(GOOD, georeference=MOVED))),
        (listing(), encode_map_update(replace(GOOD, from_version=2))),
    ],
)
def test_a_service_that_talks_nonsense_changes_nothing(tiles, tile, car):
    with answering(lambda path: tiles if "bbox" in path else tile) as url:
        driven = car(url)
        before = driven.map
        with pytest.raises(AutowazeError):
            driven.follow()
        assert driven.map is before
        assert driven.follower.version == 0


def test_a_tile_that_unpacks_to_too_much_is_refused(monkeypatch, car):
    monkeypatch.setattr(tile_follower, "MOST_TILE_FEATURES", 1000)
    reply = encode_map_update(BOMB)
    with (
        answering(lambda path: listing() if "bbox" in path else reply) as url,
        pytest.raises(AutowazeError, match="4096"),
    ):
        car(url).follow()


def test_features_of_a_neighbouring_tile_are_refused(car):
    reply = encode_map_update(GOOD)
    with (
        answering(lambda path: listing() if "bbox" in path else reply) as url,
        pytest.raises(BadMapError, match="else"),
    ):
        car(url).follow()


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"[]",
        b'{"spots": {}}',
        b'{"spots": [7]}',
        b'{"spots": [{"spot_id": "a", "lon": 1, "lat": 1, "distance_m": "NaN", "probability_on_arrival": 1}]}',
        b'{"spots": [{"spot_id": "a", "lon": 1, "lat": 1, "distance_m": 1, "probability_on_arrival": 7}]}',
    ],
)
def test_a_list_of_free_spots_that_is_none_is_named(answer, connect):
    with answering(lambda path: answer) as url, pytest.raises(AutowazeError, match="not a list of spots"):
        nearest_vacant(connect(url), -73.0, 40.0)


def test_free_spots_are_shown_in_a_line(connect):
    spot = {"spot_id": "S\x1b[2J1", "lon": -73, "lat": 40, "distance_m": 41.7, "probability_on_arrival": 0.93}
    with answering(lambda path: json.dumps({"spots": [spot] * 9}).encode()) as url:
        spots = nearest_vacant(connect(url), -73.0, 40.0)
    assert len(spots) == 5
    assert in_words(spots[:1]) == "free near here: S[2J1 in 42 m (93%)"
    assert in_words([]) == "no free spot known near here"


def test_a_drive_never_waits_for_the_network_and_catches_up_after_it_was_cut(tmp_path, car):
    with running(tmp_path / "cloud.db") as site:
        url = site.url
        site.hand_in(encode_diff(report(1, around(HERE, 30))))
        driven = car(url)
        downlink = LiveDownlink(driven.connection, driven.follower, GEOREFERENCE, lambda: 0.0)
        assert downlink.arrivals(HERE).map is None
        assert downlink.settle(10)
        driven.map = downlink.arrivals(HERE).map.applied_to(driven.map)
        assert downlink.settle(10)
    downlink.arrivals(HERE)
    assert downlink.settle(10)
    assert url in downlink.trouble
    assert downlink.arrivals(HERE).map is None
    downlink.close()
    assert len(driven.map) == 30
    with pytest.raises(UnreachableError):
        driven.follow()


def test_what_one_car_uploads_reaches_the_map_of_another(site, tmp_path, car, connect):
    street = Street(count=12)
    other = car(site.url)
    other.follow()
    uplink = Uplink(Outbox(tmp_path / "outbox"), HttpTransport(connect(site.url)))
    sent = [encode_diff(diff) for diff in street.drive(street.park([0, 2, 5]))]
    for message in sent:
        uplink.send(message)
    assert uplink.flush(20)
    uplink.close()
    other.follow()
    mine = site.durable.service.feature_map
    assert len(mine) > 50
    assert other.ids == mine.features.id.tolist()
    assert np.allclose(other.map.features.position, mine.features.position, atol=0.011)


@contextmanager
def answering(reply):
    """A server that says what it likes."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            body = reply(self.path)
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            try:
                self.wfile.write(body)
            except OSError:
                self.close_connection = True

        def log_message(self, *args):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
