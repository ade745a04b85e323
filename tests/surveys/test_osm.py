"""Parking maps from OpenStreetMap extracts."""

import bz2

import numpy as np
import pytest
import shapely
from extract import ORIGIN, Extract

from autowaze.world.errors import MapFileError
from autowaze.world.parking import ParkingMap
from autowaze.world.spot_check import check_spots
from autowaze.world.surveys import osm_extract
from autowaze.world.surveys.osm_kerbs import JUNCTION_CLEAR_M
from autowaze.world.surveys.survey import survey


def spots_of(extract, path, name="town.osm.pbf", **options):
    found = survey([extract.write(path / name)], ORIGIN, **options)
    return ParkingMap.from_drawn(found.drawn, name).spots, found


def street(extract=None, length=100.0, **tags):
    extract = extract or Extract()
    extract.way([(0.0, 0.0), (length, 0.0)], {"highway": "residential", **tags})
    return extract


@pytest.mark.parametrize("name", ["town.osm", "town.osm.bz2", "town.osm.gz", "town.osm.pbf"])
def test_a_kerb_is_cut_into_spots_whatever_the_file(tmp_path, name):
    spots, found = spots_of(
        street(**{"parking:right": "lane", "parking:right:orientation": "parallel"}), tmp_path, name
    )
    assert len(spots) == 17  # 100 m by 5.7 m
    assert {spot.kind for spot in spots} == {"parallel"}
    assert all(spot.id.startswith("osm-w101-right-") for spot in spots)
    low, high = np.array([spot.polygon.bounds for spot in spots]).T.reshape(2, 2, -1)
    assert high[1].max() == pytest.approx(-2.75, abs=0.01)  # beside a carriageway of 5.5 m
    assert low[1].min() == pytest.approx(-4.75, abs=0.01)
    assert not check_spots(found.drawn)


@pytest.mark.parametrize(
    ("tags", "left", "right", "kind"),
    [
        ({"parking:both": "lane"}, 17, 17, "parallel"),
        ({"parking:both": "lane", "parking:left": "no"}, 0, 17, "parallel"),
        ({"parking:left": "street_side", "parking:left:orientation": "perpendicular"}, 40, 0, "perpendicular"),
        ({"parking:right": "on_kerb", "parking:right:orientation": "diagonal"}, 0, 34, "angled"),
        ({"parking:both": "half_on_kerb", "parking:both:restriction": "no_stopping"}, 0, 0, None),
        ({"parking:both": "lane", "parking:left:access": "private"}, 0, 17, "parallel"),
        ({"parking:both": "separate"}, 0, 0, None),
        ({"parking:right": "lane", "parking:right:capacity": "5"}, 0, 5, "parallel"),
        ({"parking:right": "lane", "parking:right:capacity": "19"}, 0, 19, "parallel"),
        ({"parking:right": "lane", "parking:right:capacity": "-3"}, 0, 17, "parallel"),
        ({"parking:lane:both": "parallel"}, 17, 17, "parallel"),
        (
            {"parking:lane:right": "perpendicular", "parking:lane:right:perpendicular": "on_kerb"},
            0,
            40,
            "perpendicular",
        ),
        ({"parking:lane:both": "no_parking"}, 0, 0, None),
        ({"parking:lane:left": "diagonal", "parking:condition:left": "private"}, 0, 0, None),
        ({"parking:right": "no", "parking:lane:right": "parallel"}, 0, 0, None),  # the newer scheme wins
    ],
)
def test_tags_say_who_parks_where(tmp_path, tags, left, right, kind):
    extract = street(**tags)
    extract.area(500.0, 0.0, 5.0, 2.5, amenity="parking_space")  # so that there is one spot at least
    spots, _ = spots_of(extract, tmp_path)
    kerbs = [spot for spot in spots if spot.id.count("-") > 1]
    assert sum(spot.centre[1] > 0 for spot in kerbs) == left
    assert sum(spot.centre[1] < 0 for spot in kerbs) == right
    assert {spot.kind for spot in kerbs} == ({kind} if kind else set())


def test_width_is_from_kerb_to_kerb_and_holds_who_parks_on_the_carriageway(tmp_path):
    spots, _ = spots_of(street(width="9", **{"parking:right": "lane"}), tmp_path)
    assert spots[0].polygon.bounds[1] == pytest.approx(-4.5, abs=0.01)
    spots, _ = spots_of(street(width="9", **{"parking:right": "on_kerb"}), tmp_path, "other.osm.pbf")
    assert spots[0].polygon.bounds[3] == pytest.approx(-4.5, abs=0.01)


def test_junctions_keep_their_mouths_and_the_far_side_of_a_t_its_spots(tmp_path):
    extract = Extract()
    extract.way([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)], highway="residential", **{"parking:both": "lane"})
    extract.way([(50.0, 0.0), (50.0, -60.0)], highway="residential")
    spots, _ = spots_of(extract, tmp_path)
    left = shapely.union_all([s.polygon for s in spots if s.centre[1] > 0])
    right = shapely.union_all([s.polygon for s in spots if s.centre[1] < 0])
    mouth = shapely.box(50 - 2.7 - JUNCTION_CLEAR_M, -6, 50 + 2.7 + JUNCTION_CLEAR_M, 0)
    assert right.intersection(mouth).area == pytest.approx(0, abs=1e-6)
    assert right.intersection(shapely.box(35, -6, 65, 0)).area > 0
    assert left.intersection(shapely.box(42, 0, 58, 6)).area > 20


def test_a_street_that_goes_on_as_another_way_is_no_junction(tmp_path):
    extract = Extract()
    extract.way([(0.0, 0.0), (57.0, 0.0)], highway="residential", **{"parking:right": "lane"})
    extract.way([(57.0, 0.0), (114.0, 0.0)], highway="residential", **{"parking:right": "lane"})
    assert len(spots_of(extract, tmp_path)[0]) == 20


def test_driveways_crossings_and_bus_stops_stay_free(tmp_path):
    extract = Extract()
    points = [(float(x), 0.0) for x in (0, 40, 100, 200)]
    extract.way(points, highway="residential", **{"parking:right": "lane"})
    extract.way([(40.0, 0.0), (40.0, -20.0)], highway="service", service="driveway")
    extract.node(100.0, 0.0, highway="crossing")
    extract.node(160.0, -6.0, highway="bus_stop")
    spots, _ = spots_of(extract, tmp_path)
    taken = shapely.union_all([spot.polygon for spot in spots])
    for middle, half in ((40, 3.0), (100, 5.0), (160, 15.0)):
        assert not taken.intersects(shapely.box(middle - half + 0.1, -9, middle + half - 0.1, 9))
    assert len(spots) == 6 + 9 + 7 + 4  # of 37, 52, 40 and 25 m of kerb


def test_areas_beside_a_street_are_cut_across_it(tmp_path):
    extract = street()
    extract.area(
        10.0, 3.0, 25.0, 5.0, amenity="parking", parking="street_side", orientation="perpendicular", capacity="10"
    )
    extract.area(10.0, -5.0, 28.5, 2.0, amenity="parking", parking="street_side", orientation="parallel")
    extract.area(60.0, 3.0, 29.0, 5.6, amenity="parking", parking="street_side", orientation="diagonal", capacity="10")
    spots, found = spots_of(extract, tmp_path)
    kinds = [spot.kind for spot in spots]
    assert (kinds.count("perpendicular"), kinds.count("parallel")) == (10, 5)
    assert 9 <= kinds.count("angled") <= 10
    for spot in spots:
        if spot.kind == "perpendicular":
            assert spot.polygon.area == pytest.approx(12.5, abs=0.05)
        if spot.kind == "parallel":
            assert spot.polygon.area == pytest.approx(11.4, abs=0.05)
    assert not check_spots(found.drawn)


def test_mapped_spaces_win_over_kerbs_and_know_how_they_lie(tmp_path):
    extract = street(**{"parking:right": "lane"})
    extract.area(20.0, -4.75, 5.7, 2.0, amenity="parking_space")
    extract.area(60.0, -9.0, 2.5, 5.0, amenity="parking_space")
    extract.area(70.0, 4.0, 2.5, 5.0, amenity="parking_space", access="private")
    spots, found = spots_of(extract, tmp_path)
    by_id = {spot.id: spot for spot in spots}
    assert by_id["osm-w102"].kind == "parallel"
    assert by_id["osm-w103"].kind == "perpendicular"
    assert "osm-w104" not in by_id
    assert found.left_out["parking_space: access=private"] == 1
    assert found.left_out["spots: another one lies there"] >= 1
    assert not check_spots(found.drawn)


def test_streets_and_buildings_come_along(tmp_path):
    extract = street(name="Elm Street", maxspeed="20 mph", oneway="yes", lanes="2", **{"parking:right": "lane"})
    extract.area(10.0, 20.0, 12.0, 8.0, building="yes", **{"building:levels": "4"})
    extract.area(40.0, 20.0, 12.0, 8.0, building="house", height="7.5 m")
    outer = [extract.way([(70, 20), (90, 20), (90, 40)]), extract.way([(90, 40), (70, 40), (70, 20)])]
    members = [("w", way, "outer") for way in outer]
    extract.relations.append((7, members, {"type": "multipolygon", "building": "yes", "height": "12"}))
    extract.way([(0.0, 50.0), (50.0, 50.0)], highway="footway")
    _, found = spots_of(extract, tmp_path)
    network = found.streets
    assert network.streets.name.tolist() == ["Elm Street", ""]
    assert network.streets.speed_kmh[0] == pytest.approx(32.2, abs=0.05)
    assert network.streets.oneway.tolist() == [True, False]
    assert network.streets.width_m[0] == 6.0
    assert network.streets.driving.tolist() == [True, False]
    assert sorted(network.buildings.height_m.tolist()) == [7.5, 12.0, 12.0]
    assert sorted(round(p.area) for p in network.buildings.outline) == [96, 96, 400]


def test_only_what_lies_in_the_box(tmp_path):
    extract = street(**{"parking:right": "lane"})
    extract.way([(5000.0, 0.0), (5100.0, 0.0)], highway="residential", **{"parking:right": "lane"})
    (west, south), (east, north) = ORIGIN.to_lon_lat(np.array([[-10.0, -10.0], [110.0, 10.0]]))
    spots, _ = spots_of(extract, tmp_path, box=(west, south, east, north))
    assert len(spots) == 17


def test_angled_bays_open_towards_the_traffic(tmp_path):
    tags = {"parking:both": "lane", "parking:both:orientation": "diagonal"}
    spots, _ = spots_of(street(**tags), tmp_path)
    for spot in spots:
        corners = np.array(spot.polygon.exterior.coords)[:4]
        along = corners[1] - corners[0]
        nose = along / np.linalg.norm(along) * (1 if along[1] * spot.centre[1] > 0 else -1)  # away from the lane
        assert np.sign(nose[0]) == (1 if spot.centre[1] < 0 else -1)  # right: with the way; left: against it


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.osm", b""),
        ("words.osm", b"not an extract"),
        ("words.osm.pbf", b"not an extract" * 100),
        ("words.osm.bz2", b"not an extract"),
        ("cut.osm.bz2", bz2.compress(b"<osm version='0.6'>")[:20]),
        ("nothing.osm", b"<osm version='0.6'></osm>"),
        (
            "bomb.osm",
            b'<!DOCTYPE osm [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
            b"<osm version='0.6'><node id='1' lat='1' lon='1'><tag k='highway' v='&b;'/></node></osm>",
        ),
        ("file.osm", b'<!DOCTYPE osm [<!ENTITY x SYSTEM "file:///etc/passwd">]><osm version="0.6">&x;</osm>'),
        ("id.osm", b"<osm version='0.6'><node id='99999999999999999999999' lat='1' lon='1'/></osm>"),
        ("place.osm", b"<osm version='0.6'><node id='1' lat='1e99' lon='x'/></osm>"),
    ],
)
def test_hostile_files_are_refused_in_one_line(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MapFileError, match=name.replace(".", r"\.")) as refused:
        survey([path])
    assert "\n" not in str(refused.value)


def test_a_file_that_unpacks_without_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(osm_extract, "MOST_UNPACKED_BYTES", 1 << 20)
    path = tmp_path / "zeros.osm.bz2"
    path.write_bytes(bz2.compress(b" " * (50 << 20)))
    assert path.stat().st_size < 1000
    with pytest.raises(MapFileError, match="unpacks to more"):
        survey([path])


def test_too_many_objects_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(osm_extract, "MOST_WAYS", 3)
    extract = Extract()
    for i in range(5):
        extract.way([(0.0, float(i)), (9.0, float(i))], highway="residential")
    with pytest.raises(MapFileError, match="more than 3 objects"):
        spots_of(extract, tmp_path)
