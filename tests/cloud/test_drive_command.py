"""`autowaze drive --cloud`: a car in a process of its own, and a service in another."""

import json
import shutil
import subprocess
import sys

import httpx
from service_process import serve


def test_a_car_tells_a_service_of_a_real_street(kitti, tmp_path):
    drive = kitti / "odometry_00"
    shutil.copy(drive / "parking_map.geojson", tmp_path / "spots.geojson")
    process, port = serve(tmp_path, 0)
    url = f"http://127.0.0.1:{port}"
    try:
        car = subprocess.run(
            [
                *(sys.executable, "-c", "from autowaze.cli.main import run; run()", "drive", drive, "--cloud", url),
                *("--spots", drive / "parking_map.geojson", "--start", "first-true-pose", "--frames", "0:60"),
                *("--outbox", tmp_path / "outbox", "--json", tmp_path / "drive.json"),
            ],
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
        assert car.returncode == 0, car.stderr
        answer = httpx.get(f"{url}/spots.geojson", timeout=10).raise_for_status().json()
    finally:
        process.terminate()
        process.wait(20)
    said = {spot["id"]: spot["properties"]["state"] for spot in answer["features"]}
    truth = json.loads((drive / "truth.json").read_text())
    for spot in ("LB-1", "LB-2", "LB-3", "LB-4", "LC-1"):
        assert said[spot] == ("occupied" if truth[spot]["occupied"] else "vacant")
    metrics = json.loads((tmp_path / "drive.json").read_text())["metrics"]
    # As often as this machine has time for; it says so where that is not every frame.
    assert 1 <= metrics["segment_every"] <= 5
    assert ("is segmented" in car.stdout) == (metrics["segment_every"] > 1)
