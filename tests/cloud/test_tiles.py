"""A car follows the tiles around it, however long it was away."""

from dataclasses import replace

import numpy as np
import pytest
from serving import assert_problem
from street import GEOREFERENCE, Street, features

from autowaze.cloud import map_tiles
from autowaze.cloud.integration import MapState
from autowaze.cloud.map_tiles import OutdatedMapError
from autowaze.cloud.service import CloudService
from autowaze.world.feature_map import FeatureMap, MapFeatures
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.map_update import MapUpdate
from autowaze.world.tiles import tiles_of_map
from autowaze.world.wire import decode_map_update

SIDE_M = 900.0


def diffs(count, seed=0):
    """Diffs that bring features all over some tiles and take older ones out."""
    rng = np.random.default_rng(seed)
    alive: list[int] = []
    for session in range(1, count + 1):
        position = rng.uniform(0, SIDE_M, (20, 3))
        new = features(session, 0, position, [np.full(20, 1)], 1.0)
        gone = rng.choice(alive, min(12, len(alive)), replace=False) if alive else []
        alive = [i for i in alive if i not in set(gone)] + new.id.tolist()
        yield SemanticMapDiff(session, 0, 1.0, 2.0, new=new, removed=np.sort(np.array(gone, np.uint64)))


def in_tile(features, tile):
    return features[np.array([tuple(t) == tile for t in tiles_of_map(features.position, GEOREFERENCE)], bool)]


def test_a_car_that_fetches_changed_tiles_has_what_the_service_has():
    state = MapState(georeference=GEOREFERENCE)
    carried: dict[tuple, FeatureMap] = {}
    for number, diff in enumerate(diffs(40)):
        change = state.integrate(diff)
        positions = np.concatenate([change.added.position, diff.new.position[:0]])
        assert {tuple(t) for t in tiles_of_map(positions, GEOREFERENCE).tolist()} <= set(change.tiles)
        if number % 7:
            continue  # the car is away for a while
        for tile in state.tiles.records:
            have = carried.get(tile)
            since = None if have is None else have.version
            if since is not None and since >= state.tiles.version(tile):
                continue
            update = state.tile_update(tile, since)
            empty = FeatureMap(MapFeatures.empty(), GEOREFERENCE, update.from_version)
            carried[tile] = MapUpdate.applied_to(update, have or empty)
    assert len(carried) > 9
    for tile, feature_map in carried.items():
        expected = in_tile(state.features, tile) if feature_map.version >= state.tiles.version(tile) else None
        if expected is not None:
            assert np.array_equal(feature_map.features.id, expected.id)


def test_what_is_gone_is_remembered_within_bounds(monkeypatch):
    monkeypatch.setattr(map_tiles, "MOST_GONE", 8)
    state = MapState(georeference=GEOREFERENCE)
    for diff in diffs(60):
        state.integrate(diff)
    assert all(record.gone_count <= 8 + 12 for record in state.tiles.records.values())
    tile = next(iter(state.tiles.records))
    with pytest.raises(OutdatedMapError, match="whole"):
        state.tile_update(tile, 1)
    with pytest.raises(OutdatedMapError, match="yet to come"):
        state.tile_update(tile, state.version + 1)
    assert np.array_equal(state.tile_update(tile, None).added.id, in_tile(state.features, tile).id)


def test_blocks_of_which_nothing_is_left_cost_nothing():
    state = MapState(georeference=GEOREFERENCE)
    first = next(diffs(1))
    state.integrate(first)
    removal = SemanticMapDiff(99, 0, 1.0, 2.0, removed=first.new.id)
    state.integrate(removal)
    assert not any(record.blocks for record in state.tiles.records.values())
    assert len(state.vehicle_features(np.unique(first.new.instance_key))) == 0
    assert state.integrate(first) is None
    again = state.integrate(replace(removal, session=100))
    assert len(again.removed) == 0


def test_an_update_names_its_tiles():
    street = Street(count=4)
    service = CloudService(street.parking_map)
    updates = [service.integrate(diff) for diff in street.drive(street.park([0, 2]))]
    tiles = {tile for update in updates for tile in update.spot_tiles}
    assert tiles == {tuple(t) for t in tiles_of_map(service.spots.centre, GEOREFERENCE).tolist()}
    assert {tile for update in updates for tile in update.map_tiles} == set(service.map.tiles.records)


def test_tiles_over_http(site, payloads):
    listed = site.client.get("/map/tiles").json()
    assert listed["zoom"] == 17
    assert {tile["map_version"] for tile in listed["tiles"]} == {None}
    for payload in payloads:
        site.hand_in(payload)
    listed = site.client.get("/map/tiles", params={"bbox": "-73.001,39.999,-72.999,40.001"}).json()
    assert listed["version"] == len(payloads)
    total = 0
    for tile in listed["tiles"]:
        where = f"/map/tiles/17/{tile['x']}/{tile['y']}"
        answer = site.client.get(where)
        update = decode_map_update(answer.content)
        total += len(update.added)
        assert update.to_version == listed["version"]
        assert site.client.get(where, headers={"If-None-Match": answer.headers["ETag"]}).status_code == 304
        later = decode_map_update(site.client.get(where, params={"since": listed["version"]}).content)
        assert len(later.added) == len(later.removed) == 0
    assert total == len(site.durable.service.feature_map) > 0
    assert site.client.get("/map/tiles", params={"bbox": "10,10,11,11"}).json()["tiles"] == []
    assert_problem(site.client.get("/map/tiles/17/1/1", params={"since": 10**6}), 410, "map_outdated")
