"""Cars as operators see them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from serving import NOW, assert_problem, running
from street import GEOREFERENCE

from autowaze.cloud.fleet import MOST_PATH_POINTS, SILENT_S, Fleet
from autowaze.cloud.store.tokens import Scope, TokenRegister
from autowaze.world.map_diff import SemanticMapDiff, Trajectory
from autowaze.world.wire import encode_diff


def told(session, sequence, times, speed=10.0, heading=0.0):
    """A diff of a car that drives north."""
    times = np.asarray(times, dtype=np.float64)
    along = speed * (times - 1000.0)
    position = np.column_stack([np.zeros(len(times)), along, np.zeros(len(times))])
    path = Trajectory(times, position, np.full(len(times), heading, np.float32))
    return SemanticMapDiff(session, sequence, times[0], times[-1] + 1.0, trajectory=path)


def test_a_car_is_where_its_newest_diff_left_it():
    fleet = Fleet(now=None)
    fleet.note(told(1, 1, [1005.0, 1006.0, 1007.0]))
    late = fleet.note(told(1, 0, [1000.0, 1001.0]))
    assert len(late.path) == 0
    (car,) = fleet.cars()
    assert car.position[1] == pytest.approx(70.0)
    assert (car.at, car.speed_mps) == (1007.0, pytest.approx(10.0))
    overlapping = fleet.note(told(1, 2, [1006.5, 1007.0, 1008.0]))
    assert overlapping.path.time.tolist() == [1008.0]
    assert fleet.cars()[0].speed_mps == pytest.approx(10.0)


def test_silent_cars_vanish_and_so_do_those_of_long_ago():
    clock, now = [0.0], [1010.0]
    fleet = Fleet(lambda: now[0], lambda: clock[0])
    fleet.note(told(1, 0, [1000.0]))
    clock[0] += 400.0
    fleet.note(told(2, 0, [1000.0]))
    assert len(fleet.cars()) == 2
    clock[0] += SILENT_S - 300.0
    assert [car.car for car in fleet.cars()] == [fleet.pseudonym(2)]
    now[0] += SILENT_S
    fleet.note(told(3, 0, [1000.0]))  # out of an outbox
    assert fleet.cars() == []


def test_memory_does_not_grow_with_the_cars_that_ever_came(monkeypatch):
    monkeypatch.setattr("autowaze.cloud.fleet.MOST_CARS", 100)
    fleet = Fleet(now=None)
    for session in range(1000):
        fleet.note(told(session, 0, [1000.0]))
    assert len(fleet.cars()) == 100
    crowded = fleet.note(told(1, 0, 1000.0 + 0.01 * np.arange(2000)))
    assert len(crowded.path) == MOST_PATH_POINTS


def test_pseudonyms_say_nothing_of_a_session_and_change_with_the_process():
    one, other = Fleet(None), Fleet(None)
    assert one.pseudonym(7) == one.pseudonym(7)
    assert len({one.pseudonym(session) for session in range(1000)}) == 1000
    assert one.pseudonym(7) != other.pseudonym(7)


def server_sent(lines):
    kind = None
    for line in lines:
        name, _, value = line.partition(": ")
        if name == "event":
            kind = value
        elif name == "data":
            yield kind, json.loads(value)


def test_operators_see_cars_and_diffs_as_they_come(site, diffs):
    site.client.timeout = 10
    with site.client.stream("GET", "/fleet/changes") as stream:
        lines = stream.iter_lines()
        assert next(lines).startswith(":")
        payload = encode_diff(diffs[0])
        site.hand_in(payload)
        events = server_sent(lines)
        kind, car = next(events)
        assert kind == "car"
        lon, lat, heading, at = car["path"][-1]
        assert (lon, lat) == pytest.approx(GEOREFERENCE.to_lon_lat(diffs[0].trajectory.position)[-1], abs=1e-7)
        assert heading == pytest.approx(np.degrees(site.street.heading), abs=0.1)
        assert at == diffs[0].trajectory.time[-1]
        kind, diff = next(events)
        assert (kind, diff["car"], diff["sequence"], diff["map_version"]) == ("diff", car["car"], 0, 1)
        assert (diff["bytes"], diff["new"]) == (len(payload), len(diffs[0].new))
        site.hand_in(payload)  # a second time: no news
        site.hand_in(encode_diff(replace(diffs[1], session=diffs[0].session)))
        assert next(events)[1]["path"][0][3] == diffs[1].trajectory.time[0]
    assert site.client.get("/fleet").json()["cars"] == []  # of a quarter of an hour ago
    site.now = 1010.0
    (shown,) = site.client.get("/fleet").json()["cars"]
    assert shown["car"] == car["car"]
    assert shown["speed_mps"] == pytest.approx(8.0, rel=0.05)


def test_only_operators_see_cars(tmp_path, diffs):
    register = TokenRegister(tmp_path / "cloud.db", lambda: NOW)
    car = register.add("car-1", frozenset({Scope.DIFFS, Scope.MAP}))
    operator = register.add("desk", frozenset({Scope.OPERATOR}))
    with running(tmp_path / "cloud.db", register) as site:
        for path in ("/fleet", "/fleet/changes"):
            assert_problem(site.client.get(path), 401, "unauthorized")
            assert_problem(site.client.get(path, headers={"Authorization": f"Bearer {car}"}), 403, "forbidden")
        assert site.client.get("/fleet", headers={"Authorization": f"Bearer {operator}"}).json() == {"cars": []}


def test_a_token_that_is_revoked_ends_its_stream(tmp_path, diffs, monkeypatch):
    monkeypatch.setattr("autowaze.cloud.api.fleet.ADMITTED_FOR_S", 0.0)
    register = TokenRegister(tmp_path / "cloud.db", lambda: NOW)
    car = register.add("car-1", frozenset({Scope.DIFFS}))
    operator = register.add("desk", frozenset({Scope.OPERATOR}))
    with (
        running(tmp_path / "cloud.db", register) as site,
        site.client.stream("GET", "/fleet/changes", headers={"Authorization": f"Bearer {operator}"}) as stream,
    ):
        lines = stream.iter_lines()
        next(lines)
        site.hand_in(encode_diff(diffs[0]), Authorization=f"Bearer {car}")
        assert next(server_sent(lines))[0] == "car"
        register.revoke("desk")
        site.hand_in(encode_diff(diffs[1]), Authorization=f"Bearer {car}")
        assert [kind for kind, _ in server_sent(lines)] in ([], ["diff"])
