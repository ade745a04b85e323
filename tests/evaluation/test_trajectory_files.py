"""Trajectories in TUM and KITTI format: what evo reads is what we wrote, and the other way round."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from autowaze.cli.evaluate import app
from autowaze.evaluation.pose_pictures import Estimate, draw_localization, draw_odometry
from autowaze.evaluation.trajectory import absolute_errors
from autowaze.evaluation.trajectory_file import read_trajectory, write_tum
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.errors import AutowazeError
from autowaze.world.pose import make_pose, so3_exp

TIMES = 1.7e9 + 0.1 * np.arange(30)


def poses(n: int = 30) -> np.ndarray:
    turns = np.linspace(0.0, 2.5, n)
    return np.stack([make_pose(so3_exp(np.array([0.1, t, -0.2])), np.array([3 * t, t**2, 9 * t])) for t in turns])


def write_kitti(path: Path, T: np.ndarray) -> Path:
    np.savetxt(path, T[:, :3].reshape(len(T), 12))
    return path


def test_evo_reads_what_we_write(tmp_path: Path) -> None:
    from evo.tools import file_interface

    write_tum(tmp_path / "ours.tum", TIMES, poses())
    read = file_interface.read_tum_trajectory_file(str(tmp_path / "ours.tum"))
    assert np.allclose(np.stack(read.poses_se3), poses(), atol=1e-7)
    assert np.allclose(read.timestamps, TIMES, atol=1e-6)


def test_we_read_what_evo_writes(tmp_path: Path) -> None:
    from evo.core.trajectory import PoseTrajectory3D
    from evo.tools import file_interface

    trajectory = PoseTrajectory3D(poses_se3=list(poses()), timestamps=TIMES)
    file_interface.write_tum_trajectory_file(str(tmp_path / "evo.tum"), trajectory)
    file_interface.write_kitti_poses_file(str(tmp_path / "evo.txt"), trajectory)
    for name in ("evo.tum", "evo.txt"):
        frames, T = read_trajectory(tmp_path / name).matched(TIMES)
        assert frames.tolist() == list(range(30))
        assert np.allclose(T, poses(), atol=1e-6)


def test_times_join_poses_and_frames(tmp_path: Path) -> None:
    shuffled = np.random.default_rng(2).permutation(np.arange(5, 25))
    late = TIMES + np.where(np.arange(30) % 2, 0.004, 0.02)  # every second one too late for its frame
    write_tum(tmp_path / "part.tum", late[shuffled], poses()[shuffled])
    frames, T = read_trajectory(tmp_path / "part.tum").matched(TIMES)
    assert frames.tolist() == list(range(5, 25, 2))
    assert np.allclose(T, poses()[frames], atol=1e-6)
    assert absolute_errors(T, poses()[frames], aligned=False).max < 1e-6


def test_files_of_another_drive_are_refused(tmp_path: Path) -> None:
    write_tum(tmp_path / "other.tum", TIMES - 1000.0, poses())
    with pytest.raises(AutowazeError, match="0 poses within"):
        read_trajectory(tmp_path / "other.tum").matched(TIMES)
    with pytest.raises(AutowazeError, match="20 poses without times for a drive of 30"):
        read_trajectory(write_kitti(tmp_path / "short.txt", poses(20))).matched(TIMES)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "3 or more lines"),
        ("1 2 3\n" * 5, "3 or more lines"),
        ("0 0 0 0 0 0 0 1\n" * 3 + "1 0 0 1 0 0 0 1 0 0 1 0\n", "3 or more lines"),
        ("a b c d e f g h\n" * 4, "could not convert"),
        ("0 0 nan 0 0 0 0 1\n" * 4, "line 1 is not finite"),
        ("0 0 0 0 0 0 0 9\n" * 4, "quaternion"),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n" * 4, "no rotation"),
    ],
)
def test_what_is_no_trajectory_is_refused_in_one_line(tmp_path: Path, content: str, complaint: str) -> None:
    (tmp_path / "bad.txt").write_text(content)
    with pytest.raises(AutowazeError, match=complaint) as caught:
        read_trajectory(tmp_path / "bad.txt")
    assert "bad.txt" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bytes_and_nothing_are_refused(tmp_path: Path) -> None:
    (tmp_path / "picture.png").write_bytes(bytes(range(256)))
    with pytest.raises(AutowazeError, match="not text"):
        read_trajectory(tmp_path / "picture.png")
    with pytest.raises(AutowazeError, match="cannot be read"):
        read_trajectory(tmp_path / "nothing.txt")
    with pytest.raises(AutowazeError, match="cannot be written"):
        write_tum(tmp_path / "no folder" / "ours.tum", TIMES, poses())


def test_pictures_of_odometry_and_localisation(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    disturbed = poses()
    disturbed[:, :3, 3] += rng.normal(0, 0.05, (30, 3))
    estimates = {
        "ours": Estimate(TIMES, disturbed, poses()),
        "other": Estimate(TIMES[::2], disturbed[::2], poses()[::2]),
    }
    draw_odometry(tmp_path / "odometry.png", "a drive", estimates)
    none = np.zeros(0, np.int64)
    states = [TrackingState.ODOMETRY] * 3 + [TrackingState.LOCALIZED] * 27
    tracked = [
        TrackedFrame(i, time, state, "", T, np.eye(6), 50, 50, none, none)
        for i, (time, state, T) in enumerate(zip(TIMES.tolist(), states, disturbed, strict=True))
    ]
    draw_localization(tmp_path / "localization.png", "in a map", tracked, poses())
    for name in ("odometry.png", "localization.png"):
        assert (tmp_path / name).stat().st_size > 20_000


def test_the_command_scores_another_systems_trajectory_beside_ours(kitti: Path, tmp_path: Path) -> None:
    drive, ours, out = kitti / "odometry_00", tmp_path / "ours.tum", tmp_path / "both.json"
    first = ["odometry", str(drive), "--frames", "20:32"]
    assert CliRunner().invoke(app, [*first, "--trajectory", str(ours)]).exit_code == 0
    plot = tmp_path / "both.png"
    again = CliRunner().invoke(app, [*first, "--against", str(ours), "--json", str(out), "--plot", str(plot)])
    assert again.exit_code == 0, again.output
    results = json.loads(out.read_text())["results"]
    assert results["ours"]["rpe_mean_cm"] == pytest.approx(results["autowaze"]["rpe_mean_cm"], rel=1e-3)
    assert plot.stat().st_size > 20_000
    two = CliRunner().invoke(app, ["odometry", str(drive), str(drive), "--plot", str(plot)])
    assert isinstance(two.exception, AutowazeError) and "for one drive" in str(two.exception)
