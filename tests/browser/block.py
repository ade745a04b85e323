"""The street of the tests, what stands beside it, and how cars drive through."""

import time

import numpy as np
from shapely import LineString, Polygon
from street import GEOREFERENCE, Street

from autowaze.world.streets import StreetNetwork, buildings, streets
from autowaze.world.wire import encode_diff

STREET = Street(count=8)
ACCENT = {"light": (43, 80, 224), "dark": (127, 155, 255)}


def surroundings():
    """A lane with houses on both sides."""
    along, across = STREET.along, STREET.across
    lane = LineString([along * -20, along * (STREET.length + 20)])
    houses = [
        Polygon(
            [along * s + across * a for s, a in ((at, side), (at + 9, side), (at + 9, side * 1.8), (at, side * 1.8))]
        )
        for at in range(0, 60, 12)
        for side in (-12, 12)
    ]
    return StreetNetwork(GEOREFERENCE, streets([lane], ["Test Lane"]), buildings(houses, [8.0] * len(houses)))


def drive_by(site, parked, session):
    """A car drives through while others are parked; returns when the last diff is acknowledged."""
    for diff in STREET.drive(STREET.park(parked, session), session, time.time() - 20, seed=session):
        response = site.hand_in(encode_diff(diff))
        assert response.status_code == 202, response.text


def lon_lat_of(spot):
    """Middle of a spot."""
    return GEOREFERENCE.to_lon_lat(STREET.centre(spot)[None])[0]


def looking_at(spot, zoom=20):
    """Address of the page, seen from straight above a spot."""
    lon, lat = lon_lat_of(spot)
    return f"/#map={zoom}/{lat:.7f}/{lon:.7f}"


def states(site):
    """What the service says of every spot."""
    features = site.client.get("/spots.geojson").json()["features"]
    return {f["id"]: f["properties"]["state"] for f in features}


def picture(page):
    """What the map's canvas shows, (H, W, 3) uint8, RGB."""
    import cv2

    png = page.locator("#map canvas").screenshot()
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR))[:, :, ::-1]


def share_of(image, colour, tolerance=25):
    """Part of the pixels that have nearly this colour."""
    return float((np.abs(image.astype(int) - colour).max(axis=2) <= tolerance).mean())
