import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from small_street import small_street

from autowaze.simulator import SimulatedTrace, record
from autowaze.simulator.street import build_street
from autowaze.simulator.surroundings import streets_geojson
from autowaze.traces import open_trace
from autowaze.traces.recorded import RecordedTrace
from autowaze.world.errors import TraceError
from autowaze.world.parking import ParkingMap

FRAMES = 6


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drives") / "elm"
    assert record(small_street(ego={"frames": FRAMES, "start_m": 20.0}), folder, workers=1) == FRAMES
    return folder


def test_a_recording_is_the_drive(recorded: Path) -> None:
    simulated = SimulatedTrace(small_street(ego={"frames": FRAMES, "start_m": 20.0}))
    trace = open_trace(recorded)
    assert isinstance(trace, RecordedTrace)
    assert len(trace) == FRAMES
    assert trace.camera == simulated.camera
    assert trace.ground_truth is not None
    assert np.allclose(trace.ground_truth.T_world_cam, simulated.ground_truth.T_world_cam, atol=1e-6)
    ours, theirs = simulated[3], trace[3]
    assert np.array_equal(ours.left, theirs.left)
    assert np.array_equal(ours.right, theirs.right)
    assert ours.gnss == theirs.gnss
    assert ours.timestamp == theirs.timestamp
    simulated.close()


def test_fixes_lie_near_the_truth(recorded: Path) -> None:
    trace = RecordedTrace(recorded)
    assert trace.parking_map is not None
    georeference = ParkingMap.from_geojson(trace.parking_map).georeference
    assert trace.ground_truth is not None
    for frame, T in zip(trace, trace.ground_truth.T_world_cam, strict=True):
        assert frame.gnss is not None
        east_north = georeference.to_map(np.array([[frame.gnss.lon_deg, frame.gnss.lat_deg]]))[0, :2]
        assert 0.01 < np.linalg.norm(east_north - T[:2, 3]) < 6.0


def test_truth_tells_every_spot_and_vehicle(recorded: Path) -> None:
    truth = json.loads((recorded / "ground_truth" / "truth.json").read_text())
    spots = ParkingMap.from_geojson(recorded / "parking_map.geojson")
    assert set(truth["spots"]) == {spot.id for spot in spots.spots}
    vehicles = json.loads((recorded / "ground_truth" / "vehicles.json").read_text())["vehicles"]
    by_id = {v["id"]: v for v in vehicles}
    for spot_id, spot in truth["spots"].items():
        if spot["vehicle_id"] in by_id:
            centre = by_id[spot["vehicle_id"]]["center_xyz"]
            assert np.linalg.norm(spots.by_id[spot_id].centre - centre[:2]) < 1.5


def test_streets_and_buildings_lie_beside_the_parking_map(recorded: Path) -> None:
    spots = ParkingMap.from_geojson(recorded / "parking_map.geojson")
    features = json.loads((recorded / "streets.geojson").read_text())["features"]
    shapes: dict[str, list[shapely.Geometry]] = {}
    for feature in features:
        shape = shapely.transform(
            shapely.geometry.shape(feature["geometry"]), lambda lon_lat: spots.georeference.to_map(lon_lat)[:, :2]
        )
        shapes.setdefault(feature["properties"]["kind"], []).append(shape)
    assert set(shapes) == {"street", "area", "building", "tree"}
    polygons = shapely.union_all([spot.polygon for spot in spots.spots])
    assert not any(shape.intersects(polygons) for shape in shapes["building"] + shapes["tree"] + shapes["street"])
    assert all(0.5 < shapely.distance(shapely.union_all(shapes["street"]), spot.polygon) < 4.0 for spot in spots.spots)
    assert all(5.0 < f["properties"]["height_m"] < 30.0 for f in features if f["properties"]["kind"] == "building")
    main, *cross = [f["geometry"]["coordinates"] for f in features if f["properties"]["kind"] == "street"]
    assert all(any(position in main for position in line) for line in cross)  # a route can turn there


def test_the_map_of_a_street_does_not_tell_who_parks_there() -> None:
    maps = [
        streets_geojson(build_street(small_street(drive=drive, parking={"occupancy": o})))
        for drive, o in ((0, 0), (1, 1))
    ]
    assert maps[0] == maps[1]


def test_a_recording_cut_short_goes_on_and_ends_the_same(recorded: Path, tmp_path: Path) -> None:
    copy = tmp_path / "elm"
    for name, content in contents(recorded).items():
        path = copy / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    (copy / "trace.json").unlink()
    (copy / "ground_truth" / "views" / "000004.json").unlink()
    (copy / "left" / "000004.png").write_bytes(b"half a picture")
    assert not RecordedTrace.recognises(copy)
    reported: list[tuple[int, int]] = []
    record(
        small_street(ego={"frames": FRAMES, "start_m": 20.0}),
        copy,
        workers=1,
        progress=lambda done, total: reported.append((done, total)),
    )
    assert reported == [(FRAMES - 1, FRAMES), (FRAMES, FRAMES)]
    assert contents(copy) == contents(recorded)


def test_two_processes_write_the_same_bytes_as_one(tmp_path: Path) -> None:
    street = small_street(
        rig={"name": "free", "fx": 60.0, "baseline_m": 0.5, "width": 96, "height": 64}, ego={"frames": 17}
    )
    record(street, tmp_path / "one", workers=1)
    record(street, tmp_path / "two", workers=2)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_a_folder_with_another_drive_is_left_alone(recorded: Path) -> None:
    with pytest.raises(TraceError, match="holds another drive"):
        record(small_street(drive=9), recorded)


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "diary.txt").write_text("dear diary")
    with pytest.raises(TraceError, match="not empty"):
        record(small_street(), tmp_path)
