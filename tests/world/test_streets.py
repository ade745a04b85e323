"""Streets, buildings, areas and trees through GeoJSON."""

import json

import numpy as np
import pytest
from shapely import LineString, box

from autowaze.world.errors import MapFileError
from autowaze.world.georeference import Georeference
from autowaze.world.streets import StreetNetwork, Trees, areas, buildings, streets

HERE = Georeference(49.0, 8.4, 115.0)


def small_town():
    return StreetNetwork(
        HERE,
        streets(
            [LineString([(0, 0), (100, 0), (200, 30)]), LineString([(100, 0), (100, 80)])],
            names=["Main Street", ""],
            oneway=[True, False],
            speed_kmh=[50.0, 5.0],
            driving=[True, False],
        ),
        buildings([box(10, 10, 30, 25)], [12.5]),
        areas([box(-50, -50, -10, -10)], ["grass"]),
        Trees(np.array([[5.0, -5.0], [15.0, -5.0]]), np.array([2.0, 3.5])),
    )


def test_what_is_written_is_read_again_to_the_centimetre(tmp_path):
    town = small_town()
    town.to_geojson(tmp_path / "streets.geojson")
    read = StreetNetwork.from_geojson(tmp_path / "streets.geojson")
    assert read.georeference == HERE
    assert len(read) == len(town) == 6
    for line, same in zip(read.streets.line, town.streets.line, strict=True):
        assert np.allclose(line.coords, same.coords, atol=0.01)
    assert read.streets.name.tolist() == ["Main Street", ""]
    assert read.streets.oneway.tolist() == [True, False]
    assert read.streets.driving.tolist() == [True, False]
    assert read.streets.speed_kmh.tolist() == [50.0, 5.0]
    assert read.buildings.height_m.tolist() == [12.5]
    assert read.buildings.outline[0].symmetric_difference(town.buildings.outline[0]).area < 0.7
    assert read.areas.surface.tolist() == ["grass"]
    assert np.allclose(read.trees.position, town.trees.position, atol=0.01)
    assert read.trees.radius_m.tolist() == [2.0, 3.5]


def test_the_map_frame_may_be_that_of_the_parking_map():
    other = Georeference(49.001, 8.4)
    moved = StreetNetwork.from_document(small_town().to_document(), "town", other)
    assert moved.georeference == other
    assert moved.streets.line[0].coords[0][1] == pytest.approx(-111.2, abs=0.5)


def test_kinds_of_other_programs_are_left_out():
    document = small_town().to_document()
    document["features"].insert(0, {"type": "Feature", "geometry": None, "properties": {"kind": "lamp"}})
    document["features"].insert(1, {"type": "Feature", "geometry": None, "properties": None})
    assert len(StreetNetwork.from_document(document, "town")) == 6


def street(coordinates, **properties):
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": coordinates},
        "properties": {"kind": "street", **properties},
    }


@pytest.mark.parametrize(
    ("feature", "complaint"),
    [
        (street([[8.4, 49.0]]), "2 positions"),
        (street([[8.4, 49.0], [8.4, 49.0]]), "without length"),
        (street([[8.4, 49.0], [8.4, 149.0]]), "degrees"),
        (street([[8.4, 49.0], [float("nan"), 49.0]]), "degrees"),
        (street([[8.4, 49.0], ["east", 49.0]]), "position"),
        (street([[8.4, 49.0], [8.4]]), "position"),
        (street([[8.4, 49.0], None]), "position"),
        (street([[8.4, 49.0], [120.0, -20.0]]), "1000 km"),
        (street([[8.4, 49.0], [8.41, 49.0]], speed_kmh=0), "speed_kmh"),
        (street([[8.4, 49.0], [8.41, 49.0]], speed_kmh=float("inf")), "speed_kmh"),
        (street([[8.4, 49.0], [8.41, 49.0]], width_m="wide"), "width_m"),
        (street([[8.4, 49.0], [8.41, 49.0]], oneway="yes"), "oneway"),
        ({"properties": {"kind": "building"}, "geometry": {"type": "Point", "coordinates": [8, 49]}}, "Polygon"),
        ({"properties": {"kind": "street"}}, "not a GeoJSON feature"),
        ({"properties": {"kind": "building"}, "geometry": {"type": "Polygon", "coordinates": []}}, "GeoJSON"),
        ("street", "not a GeoJSON feature"),
    ],
)
def test_a_bad_feature_is_named(feature, complaint):
    with pytest.raises(MapFileError, match=complaint):
        StreetNetwork.from_document({"type": "FeatureCollection", "features": [feature]}, "town")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"features": []}', "[" * 10_000, '{"features": [1]}', "\xff"])
def test_a_file_that_is_none_is_refused(tmp_path, text):
    (tmp_path / "streets.geojson").write_bytes(text.encode("latin-1"))
    with pytest.raises(MapFileError, match=r"streets\.geojson"):
        StreetNetwork.from_geojson(tmp_path / "streets.geojson")
    with pytest.raises(MapFileError, match="cannot be read"):
        StreetNetwork.from_geojson(tmp_path / "nothing")


def test_a_file_without_streets_says_so():
    with pytest.raises(MapFileError, match="no street"):
        StreetNetwork.from_document(json.loads('{"features": [{"properties": {}}]}'), "town")
