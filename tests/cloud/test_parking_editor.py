"""Spots drawn, corrected and erased while the service runs."""

import json
import random
import threading
import time

import numpy as np
import pytest
import shapely
from serving import STREET, assert_problem, running
from street import GEOREFERENCE, Street

from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.mqtt_broadcast import MqttBroadcast
from autowaze.cloud.api.spot_book import SpotBook
from autowaze.cloud.api.spot_sheet import SpotSheet
from autowaze.cloud.api.zones import Kerb
from autowaze.cloud.durable import DurableService
from autowaze.cloud.service import CloudService
from autowaze.cloud.spot_edits import SpotEdit, drawing, feature_of_spot
from autowaze.cloud.store import open_store
from autowaze.cloud.store.tokens import Scope, TokenRegister
from autowaze.world.parking import Occupancy, ParkingMap, ParkingSpot, SpotState
from autowaze.world.spot_check import check_spots
from autowaze.world.wire import encode_diff

GEOJSON = "application/geo+json"


def moved(spot: ParkingSpot, along_m: float = 0.0, across_m: float = 0.0, name: str | None = None) -> ParkingSpot:
    shift = STREET.along * along_m + STREET.across * across_m
    return ParkingSpot(name or spot.id, shapely.affinity.translate(spot.polygon, *shift), "parallel")


def put(site, spot, **changes):
    feature = feature_of_spot(spot, GEOREFERENCE) | changes
    return site.client.put(f"/spots/{spot.id}", content=json.dumps(feature), headers={"Content-Type": GEOJSON})


def spot(row: int) -> ParkingSpot:
    return STREET.parking_map.spots[row]


def features(site):
    return {f["id"]: f for f in site.client.get("/spots.geojson").json()["features"]}


def test_a_corrected_spot_is_judged_by_what_is_known_and_the_others_stay(site, payloads):
    for payload in payloads:
        site.hand_in(payload)
    before = features(site)
    answer = put(site, moved(spot(2), 0.3, 0.1))
    assert answer.status_code == 200
    assert answer.json()["properties"]["state"] == before["S2"]["properties"]["state"] == "occupied"
    after = features(site)
    assert list(after) == list(before)
    assert [i for i in after if after[i] != before[i]] == ["S2"]
    assert after["S2"]["geometry"] != before["S2"]["geometry"]
    assert after["S2"]["properties"]["observed_at"] == before["S2"]["properties"]["observed_at"]


def test_the_same_outline_again_changes_nothing(site, payloads):
    for payload in payloads:
        site.hand_in(payload)
    before = [(s.occupancy, s.probability_vacant, s.observed_at) for s in site.durable.service.states]
    for row in range(STREET.count):
        assert put(site, spot(row)).status_code == 200
    after = site.durable.service.states
    assert [s.occupancy for s in after] == [occupancy for occupancy, _, _ in before]
    assert [s.probability_vacant for s in after] == pytest.approx([p for _, p, _ in before], abs=0.02)


def test_a_new_spot_sees_the_vehicle_that_stands_there_already(site):
    longer = Street(count=STREET.count + 4)  # a car is parked beyond the last spot of the map
    for diff in longer.drive(longer.park([STREET.count + 1])):
        assert site.hand_in(encode_diff(diff)).status_code == 202
    answer = put(site, longer.parking_map.spots[STREET.count + 1])
    assert answer.status_code == 201
    assert answer.json()["properties"]["state"] == "occupied"
    beside = put(site, longer.parking_map.spots[STREET.count + 3])
    assert beside.status_code == 201
    assert beside.json()["properties"]["state"] == "unknown"


def test_an_erased_spot_is_gone_from_every_feed(site, payloads):
    for payload in payloads:
        site.hand_in(payload)
    site.now += 120
    before = site.client.get("/cds/curbs/spaces").json()["data"]["spaces"]
    assert site.client.delete("/spots/S5").status_code == 204
    assert "S5" not in features(site)
    assert site.client.get("/collections/spots/items/S5").status_code == 404
    assert site.client.get("/collections/spots/items").json()["numberMatched"] == STREET.count - 1
    after = site.client.get("/cds/curbs/spaces").json()["data"]["spaces"]
    kept = {s["curb_space_id"] for s in before if s["custom_attributes"]["spot_id"] != "S5"}
    assert {s["curb_space_id"] for s in after} == kept
    events = site.client.get("/cds/events/events").json()["data"]["events"]
    assert {event["curb_space_id"] for event in events} <= kept
    assert_problem(site.client.delete("/spots/S5"), 404, "not_found")
    assert len(site.client.get("/vacant").json()) == sum(
        f["properties"]["state"] == "vacant" for f in features(site).values()
    )


def test_untouched_spots_and_zones_keep_their_cds_ids(site):
    far = moved(spot(0), along_m=-100.0, name="far")
    assert put(site, far).status_code == 201
    before = {z["curb_zone_id"]: z for z in site.client.get("/cds/curbs/zones").json()["data"]["zones"]}
    assert len(before) == 2
    put(site, moved(far, along_m=1.0))
    after = {z["curb_zone_id"]: z for z in site.client.get("/cds/curbs/zones").json()["data"]["zones"]}
    assert after.keys() == before.keys()
    assert sum(after[i]["geometry"] == before[i]["geometry"] for i in after) == 1


@pytest.mark.parametrize(
    ("change", "status", "error"),
    [
        ({"geometry": {"type": "Point", "coordinates": [0, 0]}}, 422, "spot_refused"),
        ({"geometry": None}, 422, "spot_refused"),
        ({"geometry": {"type": "Polygon", "coordinates": [[[0, 0], [0, 1], [1, 1], [0, 0]]]}}, 422, "spot_refused"),
        ({"geometry": {"type": "Polygon", "coordinates": [[[1e400, 0]] * 5]}}, 422, "spot_refused"),
        ({"geometry": {"type": "Polygon", "coordinates": [[{}] * 5]}}, 422, "spot_refused"),
        ({"geometry": {"type": "Polygon", "coordinates": [[[0, 0]] * 2000]}}, 422, "spot_refused"),
        ({"properties": {"kind": "sofa"}}, 422, "spot_refused"),
        ({"properties": {"kind": ["parallel"]}}, 422, "spot_refused"),
        ({"properties": {"spot_id": "another"}}, 422, "spot_refused"),
        ({"type": "FeatureCollection"}, 422, "spot_refused"),
    ],
)
def test_what_is_no_spot_is_refused(site, change, status, error):
    before = features(site)
    assert_problem(put(site, spot(1), **change), status, error)
    assert features(site) == before


def test_a_spot_on_others_is_refused_and_they_are_named(site):
    answer = put(site, moved(spot(3), along_m=3.0, name="new"))
    assert_problem(answer, 409, "spot_clashes")
    assert {line.split()[-1] for line in answer.json()["error_details"]} == {"S3", "S4"}


@pytest.mark.parametrize(
    ("body", "kind", "status"),
    [
        (b"[" * 60_000, GEOJSON, 400),
        (b"not json", GEOJSON, 400),
        (b'"' + b"x" * 70_000 + b'"', GEOJSON, 413),
        (b"{}", "text/plain", 415),
        (b"null", GEOJSON, 422),
    ],
)
def test_hostile_bodies_are_refused(site, body, kind, status):
    answer = site.client.put("/spots/S1", content=body, headers={"Content-Type": kind})
    assert answer.status_code == status
    assert answer.json()["error"]


def test_the_last_spot_stays(tmp_path):
    with running(tmp_path / "cloud.db", street=Street(count=1)) as site:
        assert_problem(site.client.delete("/spots/S0"), 409, "spot_clashes")


def test_only_operators_edit_and_it_is_noted_who_did(tmp_path):
    tokens = TokenRegister(tmp_path / "tokens.db")
    car, operator = (
        tokens.add("car", frozenset({Scope.DIFFS, Scope.MAP})),
        tokens.add("ann", frozenset({Scope.OPERATOR})),
    )
    with running(tmp_path / "cloud.db", tokens) as site:
        assert_problem(put(site, moved(spot(1), 0.1)), 401, "unauthorized")
        site.client.headers["Authorization"] = f"Bearer {car}"
        assert_problem(site.client.delete("/spots/S1"), 403, "forbidden")
        site.client.headers["Authorization"] = f"Bearer {operator}"
        assert put(site, moved(spot(1), 0.1)).status_code == 200
        assert site.client.delete("/spots/S2").status_code == 204
        entries = [e for e in site.durable.store.audit_entries() if e.action.startswith("spot")]
        assert [(e.actor, e.action, e.detail.split(":")[0]) for e in entries] == [
            ("ann", "spot redrawn", "S1"),
            ("ann", "spot erased", "S2"),
        ]


def test_everyone_is_told_of_a_new_parking_map(site):
    with site.client.stream("GET", "/changes") as changes:
        lines = changes.iter_lines()
        assert next(line for line in lines if line.startswith("event:")) == "event: current"
        put(site, moved(spot(1), 0.1))
        assert next(line for line in lines if line.startswith("event:")) == "event: parking_map"
        assert json.loads(next(lines).removeprefix("data:")) == {"version": 1}


def test_the_export_is_the_parking_map_that_the_service_could_start_with(site, tmp_path):
    put(site, moved(spot(1), 0.2, 0.1))
    site.client.delete("/spots/S7")
    (tmp_path / "export.geojson").write_bytes(site.client.get("/parking_map.geojson").content)
    exported = ParkingMap.from_geojson(tmp_path / "export.geojson")
    kept = site.durable.service.spots.parking_map
    assert [s.id for s in exported.spots] == [s.id for s in kept.spots]
    assert exported.georeference == kept.georeference
    for ours, theirs in zip(exported.spots, kept.spots, strict=True):
        assert shapely.hausdorff_distance(ours.polygon, theirs.polygon) < 1e-3
    assert not check_spots(exported.drawn)


def editing(edits: list[tuple[int, SpotEdit]], payloads: list[bytes], path) -> DurableService:
    """A service that takes the payloads in, and each edit before the payload of its number."""
    durable = DurableService(lambda: CloudService(STREET.parking_map), open_store(path), lambda: 2000.0)
    for number, payload in enumerate(payloads):
        for at, edit in edits:
            if at == number:
                durable.edit(edit, "ann")
        durable.receive(payload)
    for at, edit in edits:
        if at >= len(payloads):
            durable.edit(edit, "ann")
    return durable


def test_a_restart_finds_the_edited_map_and_the_same_states(tmp_path, passes):
    payloads = passes[:30]
    edits = [
        (0, drawing("S1", feature_of_spot(moved(spot(1), 0.4), GEOREFERENCE))),
        (7, SpotEdit("S3", None)),
        (7, drawing("S9", feature_of_spot(moved(spot(9), -0.4, 0.2), GEOREFERENCE))),
        (15, drawing("new", feature_of_spot(moved(spot(3), name="new"), GEOREFERENCE))),
        (22, SpotEdit("S0", None)),
        (30, drawing("S11", feature_of_spot(moved(spot(11), 0.3), GEOREFERENCE))),
    ]
    durable = editing(edits, payloads, tmp_path / "cloud.db")
    states, shapes = durable.service.states, durable.service.spots.polygons
    durable.store.close()
    again = DurableService(lambda: CloudService(STREET.parking_map), open_store(tmp_path / "cloud.db"), lambda: 1.0)
    assert again.service.states == states
    assert again.service.spots.ids == [f"S{i}" for i in (1, 2, *range(4, 12))] + ["new"]
    assert all(shapely.equals_exact(shapes, again.service.spots.polygons, 0.0))
    known = {s.spot_id: s for s in states if s.observed_at is not None}
    assert {s.spot_id: s for s in again.store.spots()} == known
    again.receive(passes[30])
    assert again.service.spots.row_of["new"] == len(states) - 1


def test_a_restart_from_a_snapshot_knows_the_edits_before_and_after_it(tmp_path, passes):
    before = [(3, drawing("S1", feature_of_spot(moved(spot(1), 0.4), GEOREFERENCE))), (5, SpotEdit("S3", None))]
    durable = editing(before, passes[:8], tmp_path / "cloud.db")
    durable.snapshot()
    durable.edit(drawing("new", feature_of_spot(moved(spot(3), name="new"), GEOREFERENCE)), "ann")
    for payload in passes[8:12]:
        durable.receive(payload)
    durable.edit(SpotEdit("S0", None), "ann")
    states = durable.service.states
    durable.store.close()
    again = DurableService(lambda: CloudService(STREET.parking_map), open_store(tmp_path / "cloud.db"), lambda: 1.0)
    assert again.service.states == states
    assert again.service.spots.ids[0] == "S1"
    assert again.service.spots.ids[-1] == "new"


def test_the_broker_gets_the_tiles_of_spots_that_were_drawn_and_erased():
    intake = Intake(None, lambda update: None)
    book = SpotBook(STREET.parking_map, intake, None)
    broadcast = MqttBroadcast(book, intake)
    broadcast._states = [SpotState(spot_id, Occupancy.UNKNOWN) for spot_id in book.sheet.ids]
    far, sheet = moved(spot(2), along_m=2000.0), book.sheet
    for edited in (far, None, moved(spot(4), 3.0, name="new")):
        spot_id = "S2" if edited is None else edited.id
        state = SpotState(spot_id, Occupancy.VACANT, 0.9, 5.0) if edited else None
        sheet = sheet.with_spot(edited) if edited else sheet.without_spot(spot_id)
        broadcast.redrawn(sheet, spot_id, state)
    told = [s["spot_id"] for tile in broadcast._changed for s in json.loads(broadcast._document(tile))["spots"]]
    assert sorted(told) == sorted(sheet.ids)
    assert any(not json.loads(broadcast._document(tile))["spots"] for tile in broadcast._changed)  # where far was


def test_an_edit_that_could_not_be_kept_has_not_happened(tmp_path, passes):
    durable = editing([], passes[:5], tmp_path / "cloud.db")
    before = durable.service.states

    def full(*_):
        raise OSError("the disk is full")

    durable.store.commit_edit = full
    with pytest.raises(OSError, match="full"):
        durable.edit(SpotEdit("S3", None), "ann")
    assert durable.service.states == before


def test_edits_while_diffs_arrive_lose_neither(site, passes):
    accepted, edited, rng = [], [], random.Random(0)

    def drive(part):
        for payload in part:
            accepted.append(site.hand_in(payload).status_code)

    cars = [threading.Thread(target=drive, args=(passes[i::3],)) for i in range(3)]
    for car in cars:
        car.start()
    while any(car.is_alive() for car in cars):
        row = rng.randrange(STREET.count)
        edited.append(put(site, moved(spot(row), rng.uniform(-0.2, 0.2))).status_code)
        assert site.client.get("/spots.geojson").status_code == 200
        assert site.client.get("/cds/curbs/zones").status_code == 200
    for car in cars:
        car.join()
    assert set(accepted) == {202}
    assert set(edited) == {200}
    states = site.durable.service.states
    assert site.durable.store.position == len(passes)
    replayed = DurableService(lambda: CloudService(STREET.parking_map), site.durable.store)
    assert replayed.service.states == states


def test_a_sheet_that_was_edited_is_the_sheet_of_the_edited_map():
    rng = np.random.default_rng(3)
    spots = list(Street(count=30).parking_map.spots) + [moved(spot(i), 12.0, 9.0, f"B{i}") for i in range(5)]
    sheet, kerb_ids = SpotSheet(ParkingMap(tuple(spots), GEOREFERENCE)), []
    for step in range(40):
        row = int(rng.integers(len(spots)))
        if step % 3 == 0:
            sheet = sheet.without_spot(spots.pop(row).id)
        elif step % 3 == 1:
            spots.append(moved(spots[row], float(rng.uniform(-30, 30)), 15.0 + 3 * step, f"N{step}"))
            sheet = sheet.with_spot(spots[-1])
        else:
            spots[row] = moved(spots[row], float(rng.uniform(-4, 4)), float(rng.uniform(-3, 3)))
            sheet = sheet.with_spot(spots[row])
        fresh = SpotSheet(ParkingMap(tuple(spots), GEOREFERENCE))
        for column in ("ids", "kinds", "rectangles", "geometries", "row_of"):
            assert getattr(sheet, column) == getattr(fresh, column), column
        assert np.array_equal(sheet.bounds_lon_lat, fresh.bounds_lon_lat)
        ours, theirs = sheet.kerb, fresh.kerb
        assert isinstance(ours, Kerb)
        assert [(z.id, z.rows, z.geometry, z.length_cm, z.parking_angle) for z in ours.zones] == [
            (z.id, z.rows, z.geometry, z.length_cm, z.parking_angle) for z in theirs.zones
        ]
        assert ours.row_of_space == theirs.row_of_space
        kerb_ids.append(len(ours.zones))
    assert max(kerb_ids) > min(kerb_ids) > 1


def test_an_edit_costs_little_in_a_city():
    """A ratio, which holds on any machine: an edit is cheap against opening the city."""
    block = Street(count=20).parking_map.spots
    spots = [
        moved(one, 200.0 * i, 60.0 * j, f"{i}-{j}-{one.id}") for i in range(10) for j in range(15) for one in block
    ]
    city = ParkingMap(tuple(spots), GEOREFERENCE)
    started = time.thread_time()
    sheet, service = SpotSheet(city), CloudService(city)
    sheet.survey()
    open_s = time.thread_time() - started
    edit = drawing(spots[1500].id, feature_of_spot(moved(spots[1500], 0.1), GEOREFERENCE))
    started = time.thread_time()
    for _ in range(5):
        sheet = sheet.with_spot(edit.spot(GEOREFERENCE))
        service.edit(edit)
    assert (time.thread_time() - started) / 5 < open_s / 10
    assert service.states[1500].occupancy is Occupancy.UNKNOWN
