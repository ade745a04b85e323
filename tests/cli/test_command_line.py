"""The door: bad input gives one line and exit code 2; figures come as JSON."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from autowaze.cli.options import parse_frames
from autowaze.world.errors import AutowazeError


def autowaze(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from autowaze.cli.main import run; run()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)


def test_a_missing_drive_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    result = autowaze("evaluate", "odometry", tmp_path / "nowhere")
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.strip().count("\n") == 0
    assert "nowhere: no such folder" in result.stderr


def test_a_missing_model_says_how_to_name_one(kitti: Path) -> None:
    drive = kitti / "odometry_00"
    result = autowaze("drive", drive, "--spots", drive / "parking_map.geojson", "--model", "/no/model.onnx")
    assert result.returncode == 2
    assert "/no/model.onnx" in result.stderr


def test_odometry_writes_its_figures(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "odometry.json"
    result = autowaze("evaluate", "odometry", kitti / "odometry_00", "--frames", "20:32", "--json", out)
    assert result.returncode == 0, result.stderr
    report = json.loads(out.read_text())
    assert report["metrics"]["frames"] == 12
    assert 0 < report["metrics"]["rpe_mean_cm"] < 3
    assert report["machine"]["cores"] >= 1
    assert report["versions"]["autowaze"]


def test_a_short_drive_leaves_a_picture_overlays_and_rectangles(
    kitti: Path, yolo_weights: Path, tmp_path: Path
) -> None:
    drive = kitti / "odometry_00"
    result = autowaze(
        "drive", drive, "--spots", drive / "parking_map.geojson", "--start", "first-true-pose", "--frames", "0:12",
        "--model", yolo_weights, "--plot", tmp_path / "birdseye.png", "--video", tmp_path / "overlays",
        "--vacant", tmp_path / "vacant.json",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "birdseye.png").stat().st_size > 20_000
    assert len(list((tmp_path / "overlays").glob("*.jpg"))) == 12
    assert isinstance(json.loads((tmp_path / "vacant.json").read_text()), list)


def test_latency_is_that_of_a_real_service_and_listener(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "latency.json"
    options = ("--frames", "0:51", "--passes", "1", "--model", "none", "--json", out)
    result = autowaze("evaluate", "latency", kitti / "odometry_00", *options)
    assert result.returncode == 0, result.stderr
    metrics = json.loads(out.read_text())["metrics"]
    assert (metrics["windows"], metrics["empty_map_windows"]) == (1, 1)
    assert metrics["diff_bytes_median"] > 1000
    parts = metrics["last_frame_to_diff_ms_median"], metrics["diff_to_listener_ms_median"]
    assert min(parts) > 0
    assert metrics["end_to_end_ms_median"] == pytest.approx(sum(parts))
    assert metrics["cloud_integration_ms_median"] > 0


def test_frames_are_first_and_end() -> None:
    assert parse_frames("110:154") == slice(110, 154)
    assert parse_frames(":20:2") == slice(None, 20, 2)
    assert parse_frames("") is None
    for wrong in ("12", "a:b", "-3:5"):
        with pytest.raises(AutowazeError, match="expected FIRST:END"):
            parse_frames(wrong)
