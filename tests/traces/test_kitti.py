"""KITTI drives: real ones, and broken ones that name the file at fault."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from autowaze.traces import open_trace
from autowaze.traces.kitti_labels import read_labels
from autowaze.world.errors import TraceError

CALIBRATION = "P0: 700 0 30 0 0 700 20 0 0 0 1 0\nP1: 700 0 30 -350 0 700 20 0 0 0 1 0\n"


def write_drive(folder: Path, frames: int = 3, first: int = 0) -> Path:
    for camera in (0, 1):
        (folder / f"image_{camera}").mkdir(parents=True)
        for i in range(first, first + frames):
            image = np.full((40, 60), 10 * camera + i, np.uint8)
            cv2.imwrite(str(folder / f"image_{camera}" / f"{i:06d}.png"), image)
    (folder / "calib.txt").write_text(CALIBRATION)
    (folder / "times.txt").write_text("".join(f"{0.1 * i}\n" for i in range(first + frames)))
    pose = "1 0 0 {} 0 1 0 0 0 0 1 0\n"
    (folder / "poses.txt").write_text("".join(pose.format(i) for i in range(first + frames)))
    return folder


def test_an_odometry_drive_reads_as_a_trace(tmp_path: Path) -> None:
    trace = open_trace(write_drive(tmp_path / "drive", first=5))
    assert len(trace) == 3
    assert (trace.camera.fx, trace.camera.baseline_m, trace.camera.width) == (700.0, 0.5, 60)
    frame = trace[1]
    assert (frame.index, frame.timestamp) == (6, pytest.approx(0.6))
    assert (frame.left[0, 0], frame.right[0, 0]) == (6, 16)
    assert trace.ground_truth is not None
    np.testing.assert_allclose(trace.ground_truth.T_world_cam[:, 0, 3], [5, 6, 7])


def test_frames_are_chosen_by_number(tmp_path: Path) -> None:
    trace = open_trace(write_drive(tmp_path / "drive", frames=6, first=10), frames=slice(11, 15, 2))
    assert [frame.index for frame in trace] == [11, 13]


def test_the_colour_pair_stands_beside_the_grey_one(kitti: Path) -> None:
    grey = open_trace(kitti / "drive_0005", cameras="grey", frames=slice(110, 154))
    colour = open_trace(kitti / "drive_0005", cameras="colour")
    assert len(grey) == len(colour) == 44
    assert colour.camera.baseline_m == pytest.approx(0.532712, abs=1e-6)
    assert colour[0].left.shape == (375, 1242, 3)
    assert grey.ground_truth is not None
    assert colour.ground_truth is not None
    offset = np.linalg.inv(grey.ground_truth.T_world_cam[7]) @ colour.ground_truth.T_world_cam[7]
    np.testing.assert_allclose(offset[:3, 3], [-0.059849, 0.000358, -0.002746], atol=1e-6)


def test_the_raw_layout_has_gnss_fixes(tmp_path: Path) -> None:
    drive = tmp_path / "2011_09_26" / "2011_09_26_drive_0001_sync"
    for camera in (0, 1):
        (drive / f"image_0{camera}" / "data").mkdir(parents=True)
        cv2.imwrite(str(drive / f"image_0{camera}" / "data" / "0000000000.png"), np.zeros((40, 60), np.uint8))
    (drive / "image_00" / "timestamps.txt").write_text("2011-09-26 13:02:25.964389445\n")
    (drive / "oxts" / "data").mkdir(parents=True)
    fix = [49.01, 8.42, 116.0, 0.0, 0.0, np.pi / 2] + [0.0] * 17 + [0.5] + [0.0] * 6
    (drive / "oxts" / "data" / "0000000000.txt").write_text(" ".join(map(str, fix)))
    rect = CALIBRATION.replace("P0", "P_rect_00").replace("P1", "P_rect_01")
    (drive.parent / "calib_cam_to_cam.txt").write_text(rect)
    frame = open_trace(drive)[0]
    assert frame.timestamp == pytest.approx(1317042145.964389)
    assert frame.gnss is not None
    assert (frame.gnss.lat_deg, frame.gnss.horizontal_sigma_m) == (49.01, 0.5)
    assert frame.gnss.heading_rad == pytest.approx(0.0)  # yaw is measured from east


def damaged(folder: Path, what: str) -> str:
    """Break a drive in one way; returns what the error must name."""
    match what:
        case "missing right image":
            (folder / "image_1" / "000001.png").unlink()
            return "image_1/000001.png"
        case "unreadable image":
            (folder / "image_0" / "000001.png").write_bytes(b"no picture")
            return "image_0/000001.png"
        case "wrong size":
            cv2.imwrite(str(folder / "image_1" / "000001.png"), np.zeros((41, 60), np.uint8))
            return "image_1/000001.png"
        case "no calibration":
            (folder / "calib.txt").unlink()
            return "calib.txt"
        case "words for numbers":
            (folder / "calib.txt").write_text(CALIBRATION.replace("700", "seven", 1))
            return "calib.txt"
        case "cameras swapped":
            (folder / "calib.txt").write_text(CALIBRATION.replace("-350", "350"))
            return "calib.txt"
        case "too few poses":
            (folder / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
            return "poses.txt"
        case _:
            (folder / "times.txt").write_text("0.0\n")
            return "no time"


@pytest.mark.parametrize(
    "what",
    [
        "missing right image",
        "unreadable image",
        "wrong size",
        "no calibration",
        "words for numbers",
        "cameras swapped",
        "too few poses",
        "too few times",
    ],
)
def test_a_damaged_drive_names_the_file_at_fault(tmp_path: Path, what: str) -> None:
    folder = write_drive(tmp_path / "drive")
    name = damaged(folder, what)
    with pytest.raises(TraceError, match=name):
        list(open_trace(folder))


def test_an_unknown_folder_says_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(TraceError, match="not a known kind of stereo drive"):
        open_trace(tmp_path)
    with pytest.raises(TraceError, match="no such folder"):
        open_trace(tmp_path / "nowhere")


def test_labels_lie_on_the_images(kitti: Path) -> None:
    """The projected bottom centre of a labelled vehicle falls into its own 2D box."""
    trace = open_trace(kitti / "drive_0005")
    labels = read_labels(kitti / "drive_0005" / "label_02.txt")
    cars = labels[(labels.kind == "Car") & (labels.position_cam[:, 2] > 5) & (labels.position_cam[:, 2] < 30)]
    middle = cars.position_cam - np.column_stack([0 * cars.yaw, cars.size[:, 0] / 2, 0 * cars.yaw])
    u, v, _ = trace.camera.project(middle).T
    inside = (cars.box[:, 0] < u) & (u < cars.box[:, 2]) & (cars.box[:, 1] < v) & (v < cars.box[:, 3])
    assert inside.mean() > 0.95


def test_a_file_that_is_no_label_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "label.txt").write_text("1 2 Car\n")
    with pytest.raises(TraceError, match="17 columns"):
        read_labels(tmp_path / "label.txt")
