"""Parking maps from GeoJSON."""

import json
from pathlib import Path

import numpy as np
import pytest

from autowaze.world.errors import MapFileError
from autowaze.world.parking import ParkingMap

RING = [[8.4, 49.0], [8.40007, 49.0], [8.40007, 49.00003], [8.4, 49.00003], [8.4, 49.0]]


def feature(spot_id: str, ring: list[list[float]] = RING, kind: str = "Polygon") -> dict[str, object]:
    geometry = {"type": kind, "coordinates": [ring]}
    return {"type": "Feature", "geometry": geometry, "properties": {"spot_id": spot_id, "kind": "parallel"}}


def collection(*features: dict[str, object], **members: object) -> dict[str, object]:
    return {"type": "FeatureCollection", "features": list(features), **members}


def test_spots_are_metres_about_the_georeference(tmp_path: Path) -> None:
    (tmp_path / "spots.geojson").write_text(
        json.dumps(collection(feature("A-1"), georeference={"lat": 49.0, "lon": 8.4, "heading_deg": 90.0}))
    )
    spots = ParkingMap.from_geojson(tmp_path / "spots.geojson")
    assert spots.by_id["A-1"].kind == "parallel"
    assert spots.survey_heading_rad == pytest.approx(np.pi / 2)
    width, height = np.ptp(np.array(spots.spots[0].polygon.exterior.coords), axis=0)
    assert (width, height) == (pytest.approx(5.12, abs=0.02), pytest.approx(3.34, abs=0.02))


def test_the_bays_of_a_real_street_are_two_and_a_half_metres_wide(kitti: Path) -> None:
    spots = ParkingMap.from_geojson(kitti / "odometry_00" / "parking_map.geojson")
    areas = [spot.polygon.area for spot in spots.spots]
    assert len(spots) == 19
    assert 10.0 < min(areas) <= max(areas) < 15.0


@pytest.mark.parametrize(
    ("document", "reason"),
    [
        ([], "FeatureCollection"),
        (collection(), "at least one spot"),
        (collection(feature("A", kind="Point")), "a spot is a Polygon"),
        (collection(feature("A", ring=RING[:2])), "four lon, lat positions"),
        (collection(feature("A", ring=[[800.4, 49.0], *RING[1:]])), "in degrees"),
        (collection(feature("A", ring=[RING[0], RING[2], RING[1], RING[3], RING[0]])), "crosses itself"),
        (collection(feature("A"), feature("A")), "share an id"),
        (collection(feature("A"), georeference={"lat": "north"}), "georeference"),
    ],
)
def test_a_wrong_parking_map_says_what_is_wrong(document: object, reason: str) -> None:
    with pytest.raises(MapFileError, match=reason):
        ParkingMap.from_document(document, "spots.geojson")


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match=r"nowhere\.geojson"):
        ParkingMap.from_geojson(tmp_path / "nowhere.geojson")
