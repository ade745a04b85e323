"""The feature map as points."""

import numpy as np
import pytest
from serving import NOW, assert_problem, running
from street import GEOREFERENCE

from autowaze.cloud.store.tokens import Scope, TokenRegister
from autowaze.cloud.thinning import share_of, thinned_evenly

EVERYWHERE = "-74,39,-72,41"


@pytest.fixture
def seen(site, payloads):
    for payload in payloads:
        assert site.hand_in(payload).status_code == 202
    return site


def test_every_feature_is_a_point(seen):
    features = seen.durable.service.map.features
    answer = seen.client.get("/map/points", params={"bbox": EVERYWHERE}).json()
    assert answer["count"] == answer["total"] == len(features) == len(answer["x"]) > 100
    points = np.column_stack([answer["x"], answer["y"], answer["z"]])
    assert sorted(map(tuple, points.tolist())) == sorted(map(tuple, np.round(features.position, 2).tolist()))
    assert set(answer["label"]) == {1}
    assert answer["origin"] == {"lon": -73.0, "lat": 40.0, "altitude_m": 0.0}
    assert answer["map_version"] == seen.durable.service.map.version


def test_only_points_in_the_box_are_sent(seen):
    position = seen.durable.service.map.features.position
    west, south = GEOREFERENCE.to_lon_lat(np.array([[0.0, 30.0]]))[0]
    answer = seen.client.get("/map/points", params={"bbox": f"{west},{south},-72.9,40.1"}).json()
    inside = (position[:, 0] >= 0.0) & (position[:, 1] >= 30.0)
    assert answer["count"] == inside.sum()
    assert 0 < answer["count"] < len(position)
    for nowhere in ("1,1,2,2", "-73,-90,-72,-89", "179,39,-179,41"):
        assert seen.client.get("/map/points", params={"bbox": nowhere}).json()["count"] == 0


def test_a_limit_thins_and_thins_the_same_way_each_time(seen):
    first, again = (seen.client.get("/map/points", params={"bbox": EVERYWHERE, "limit": 50}).json() for _ in "12")
    assert first == again
    assert first["count"] == 50 < first["total"]


def test_thinned_points_cover_what_all_covered():
    rng = np.random.default_rng(0)
    crowd = rng.normal(0, 0.5, (20_000, 3))
    sparse = np.column_stack([rng.uniform(10, 110, (500, 2)), rng.uniform(0, 3, 500)])
    position, ids = np.concatenate([crowd, sparse]), rng.permutation(20_500).astype(np.uint64)
    rows = thinned_evenly(position, ids, 1000)
    assert len(rows) == 1000
    assert (rows >= 20_000).sum() > 450  # the crowd gives way, not the lone ones
    assert rows.tolist() == sorted(set(rows.tolist()))


def test_the_order_of_points_says_nothing():
    rng = np.random.default_rng(1)
    position, ids = rng.uniform(0, 50, (5000, 3)), np.arange(5000, dtype=np.uint64)
    shuffled = rng.permutation(5000)
    rows, other = thinned_evenly(position, ids, 700), thinned_evenly(position[shuffled], ids[shuffled], 700)
    assert set(ids[rows].tolist()) == set(ids[shuffled][other].tolist())


def test_a_share_is_a_share():
    ids = np.arange(100_000, dtype=np.uint64) << np.uint64(12)
    assert share_of(ids, 0.25).mean() == pytest.approx(0.25, abs=0.01)
    assert share_of(ids, 2.0).all()
    assert not (share_of(ids, 0.1) & ~share_of(ids, 0.2)).any()


def test_points_are_for_those_who_may_fetch_the_map(tmp_path):
    register = TokenRegister(tmp_path / "cloud.db", lambda: NOW)
    car = register.add("car-1", frozenset({Scope.MAP}))
    other = register.add("car-2", frozenset({Scope.DIFFS}))
    with running(tmp_path / "cloud.db", register) as site:
        path = f"/map/points?bbox={EVERYWHERE}"
        assert_problem(site.client.get(path), 401, "unauthorized")
        assert_problem(site.client.get(path, headers={"Authorization": f"Bearer {other}"}), 403, "forbidden")
        assert site.client.get(path, headers={"Authorization": f"Bearer {car}"}).json()["count"] == 0


@pytest.mark.parametrize("query", ["", "bbox=1,2", "bbox=1,2,3,x", "bbox=1,1,2,2&limit=0", "bbox=1,1,2,2&limit=1e9"])
def test_a_wrong_question_is_answered_with_400(site, query):
    assert_problem(site.client.get(f"/map/points?{query}"), 400, "bad_parameter")
