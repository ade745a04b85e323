"""`autowaze spots`, and sources other than OpenStreetMap."""

import json

import numpy as np
import pytest
import shapely
from serving import running
from street import GEOREFERENCE, Street
from typer.testing import CliRunner

from autowaze.cli.main import app
from autowaze.simulator import load_description
from autowaze.simulator.plan.street_plan import plan_street
from autowaze.world.drawn_spots import DrawnSpots, document_of
from autowaze.world.errors import AutowazeError, MapFileError
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap
from autowaze.world.spot_check import Fault, check_spots, mended
from autowaze.world.surveys.survey import survey

ORIGIN = Georeference(52.5, 13.4)


def written(path, document):
    path.write_text(json.dumps(document))
    return path


def drawn(*rings, ids=None):
    closed = [np.array([*ring, ring[0]], dtype=np.float64) for ring in rings]
    ids = ids or tuple(f"S{i}" for i in range(len(rings)))
    lon_lat = tuple(ORIGIN.to_lon_lat(ring) for ring in closed)
    return DrawnSpots(tuple(ids), ("parallel",) * len(rings), lon_lat, ORIGIN)


def box(x, y, length=5.7, width=2.0):
    return [(x, y), (x + length, y), (x + length, y + width), (x, y + width)]


def run(*arguments):
    return CliRunner().invoke(app, ["spots", *map(str, arguments)])


class Town:
    """A simulated town as the street of a test site."""

    def __init__(self, preset):
        self.parking_map = plan_street(load_description(preset)).parking_map


@pytest.mark.parametrize("preset", ["town-a", "lot-b"])
def test_a_simulated_town_comes_back_from_its_own_curbs(tmp_path, preset):
    town = Town(preset)
    with running(tmp_path / "cloud.db", street=town) as site:
        pages = [site.client.get(f"/cds/curbs/{kind}").json() for kind in ("zones", "spaces")]
    paths = [written(tmp_path / f"{i}.json", page) for i, page in enumerate(pages)]
    found = ParkingMap.from_drawn(survey(paths, town.parking_map.georeference).drawn, "curbs")
    assert [spot.id for spot in found.spots] == [spot.id for spot in town.parking_map.spots]
    for ours, theirs in zip(found.spots, town.parking_map.spots, strict=True):
        assert shapely.hausdorff_distance(ours.polygon, theirs.polygon) < 0.1
        assert ours.kind in (theirs.kind, "unknown")


def test_zones_without_spaces_are_cut(tmp_path):
    ring = ORIGIN.to_lon_lat(np.array([*box(0, 0, 30.0, 2.1), (0, 0)]))
    geometry = {"type": "Polygon", "coordinates": [ring.tolist()]}
    zone = {"curb_zone_id": "z", "geometry": geometry, "num_spaces": 5, "parking_angle": "parallel"}
    found = survey([written(tmp_path / "zones.json", {"version": "1.1.0", "data": {"zones": [zone]}})]).drawn
    assert found.ids == tuple(f"z-{i}" for i in range(1, 6))
    assert [round(outline.area, 1) for outline in found.outlines] == [12.6] * 5


def test_polygons_with_any_properties_get_ids_and_kinds(tmp_path):
    ring = [[13.4, 52.5], [13.40008, 52.5], [13.40008, 52.50002], [13.4, 52.50002], [13.4, 52.5]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    many = {"type": "MultiPolygon", "coordinates": [[ring], [ring]]}
    features = [
        {"type": "Feature", "geometry": shape, "properties": {"OBJECTID": 7, "orientation": "diagonal"}},
        {"type": "Feature", "id": "a/b", "geometry": many, "properties": {"name": "bay", "colour": "red"}},
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [13.4, 52.5]}, "properties": None},
        {"type": "Feature", "geometry": shape, "properties": None},
    ]
    found = survey([written(tmp_path / "bays.geojson", {"type": "FeatureCollection", "features": features})])
    assert found.drawn.ids == ("7", "bay", "bay-2", "spot-4")
    assert found.drawn.kinds == ("angled", "unknown", "unknown", "unknown")
    assert found.drawn.georeference == Georeference(52.50001, 13.40004)
    assert found.left_out == {"features: Point is no polygon": 1}


@pytest.mark.parametrize(
    "document",
    [
        [], {}, {"features": []}, {"features": [None]}, {"data": {"zones": [{}]}}, {"data": {"spaces": [None]}},
        {"data": {"spaces": [{"geometry": {"type": "Polygon", "coordinates": [[[0, 0]] * 4000]}}]}},
        {"features": [{"geometry": {"type": "MultiPolygon", "coordinates": [[[["x"]]]]}}]},
    ],
)  # fmt: skip
def test_what_holds_no_spots_is_refused(tmp_path, document):
    with pytest.raises(MapFileError, match=r"source\.json"):
        survey([written(tmp_path / "source.json", document)])


def test_a_town_is_imported_and_found_good(tmp_path):
    parking_map = Street(count=6).parking_map
    source = written(tmp_path / "town.geojson", document_of(parking_map.drawn))
    output = tmp_path / "parking_map.geojson"
    result = run("import", source, "-o", output)
    assert result.exit_code == 0, result.output
    assert "6 spots" in result.output
    assert ParkingMap.from_geojson(output).georeference == GEOREFERENCE
    result = run("check", output)
    assert result.exit_code == 0
    assert "nothing wrong" in result.output


def test_streets_only_come_from_where_there_are_some(tmp_path):
    source = written(tmp_path / "town.geojson", document_of(Street(count=2).parking_map.drawn))
    result = run("import", source, "-o", tmp_path / "out.geojson", "--streets", tmp_path / "streets.geojson")
    assert isinstance(result.exception, AutowazeError)
    assert "no streets" in str(result.exception)


def test_every_fault_is_found_and_named():
    bowtie = [(0, 60), (5, 62), (5, 60), (0, 62)]
    thin = [(0, 70), (5, 70), (5, 70.5), (0, 70.5)]
    hook = [(0, 80), (5, 80), (5, 81.4), (1.4, 81.4), (1.4, 85), (0, 85)]
    spots = drawn(
        box(0, 0), box(3, 0), box(0, 20, 40, 10), bowtie, thin, hook, box(0, 90)[::-1], box(300_000, 0), box(0, 100),
        ids=("good", "over", "hall", "bowtie", "thin", "hook", "clock", "far", "good"),
    )  # fmt: skip
    found = {(finding.spot_id, finding.fault) for finding in check_spots(spots)}
    assert found >= {
        ("over", Fault.OVERLAP), ("hall", Fault.SIZE), ("bowtie", Fault.CROSSING), ("thin", Fault.SLIVER),
        ("hook", Fault.SHAPE), ("clock", Fault.WINDING), ("far", Fault.FAR), ("good", Fault.DUPLICATE_ID),
    }  # fmt: skip
    assert not any(fault is Fault.OFF_STREET for _, fault in found)
    lines = np.array([shapely.LineString([(-10, -3), (50, -3)])], dtype=np.object_)
    off = [f.spot_id for f in check_spots(spots, lines) if f.fault is Fault.OFF_STREET]
    assert {"clock", "hook"} <= set(off)
    assert "over" not in off


def test_what_has_one_cure_is_mended_and_the_rest_is_left(tmp_path):
    spots = drawn(box(0, 0)[::-1], box(10, 0), box(10, 0), box(12, 0), ids=("clock", "twice", "twice", "over"))
    path = written(tmp_path / "spots.geojson", document_of(spots))
    result = run("check", path, "--json", tmp_path / "faults.json")
    assert result.exit_code == 2
    findings = json.loads((tmp_path / "faults.json").read_text())["findings"]
    assert {(row["spot_id"], row["fault"]) for row in findings} >= {("clock", "clockwise"), ("twice", "duplicate id")}
    result = run("check", path, "--fix")
    assert result.exit_code == 2
    assert "mended: clock: clockwise" in result.output
    assert "over: overlap" in result.output
    after, done = mended(spots)
    assert after.ids == ("clock", "twice", "over")
    assert {finding.fault for finding in done} == {Fault.WINDING, Fault.DUPLICATE_ID}
    assert ParkingMap.from_geojson(path).by_id.keys() == {"clock", "twice", "over"}


@pytest.mark.parametrize("option", [("--bbox", "1,2,3"), ("--bbox", "a,b,c,d"), ("--georeference", "900,1")])
def test_options_that_make_no_sense_are_named(tmp_path, option):
    source = written(tmp_path / "town.geojson", document_of(Street(count=2).parking_map.drawn))
    result = run("import", source, "-o", tmp_path / "out.geojson", *option)
    assert isinstance(result.exception, AutowazeError)
    assert option[0] in str(result.exception)
