"""`autowaze cloud` in a process of its own, to be killed."""

import os
import re
import subprocess
import sys

from shapely.geometry import mapping


def serve(folder, port, *options):
    """`autowaze cloud` in a process of its own, ready; returns it and its port."""
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", "from autowaze.cli.main import run; run()", "cloud", "--open", "--replay"),
            *("--spots", folder / "spots.geojson", "--store", folder / "cloud.db", "--port", str(port)),
            *options,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    line = process.stdout.readline()
    process.stdout.close()
    return process, int(re.search(r":(\d+) ", line)[1])


def geojson_of(parking_map):
    reference = parking_map.georeference
    features = []
    for spot in parking_map.spots:
        geometry = mapping(spot.polygon)
        ring = [list(map(float, p)) for p in reference.to_lon_lat(list(spot.polygon.exterior.coords))]
        features.append({"type": "Feature", "id": spot.id, "geometry": {**geometry, "coordinates": [ring]}})
    member = {"lat": reference.lat_deg, "lon": reference.lon_deg, "altitude_m": reference.altitude_m}
    return {"type": "FeatureCollection", "georeference": member, "features": features}
