import json
from pathlib import Path

import numpy as np
import pytest

from autowaze.traces import open_trace
from autowaze.traces.recorded import FrameEntry, RecordedTrace, image_path, write_image, write_index, write_poses
from autowaze.world.camera import StereoCamera
from autowaze.world.errors import TraceError
from autowaze.world.frame import GnssFix

CAMERA = StereoCamera(100.0, 100.0, 31.5, 23.5, 0.3, 64, 48)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    for index in range(4):
        for side in ("left", "right"):
            write_image(image_path(tmp_path, side, index), rng.integers(0, 256, (48, 64, 3), dtype=np.uint8))
    write_poses(tmp_path, np.stack([np.eye(4) * [1, 1, 1, i + 1] for i in range(4)]))
    fix = GnssFix(8.4, 49.0, 110.0, 1.5, 0.7)
    write_index(tmp_path, CAMERA, [FrameEntry(i, 100.0 + 0.1 * i, fix if i % 2 else None) for i in range(4)])
    return tmp_path


def test_what_was_written_is_read(folder: Path) -> None:
    trace = open_trace(folder)
    assert trace.camera == CAMERA
    assert len(trace) == 4
    assert [frame.timestamp for frame in trace] == pytest.approx([100.0, 100.1, 100.2, 100.3])
    assert trace[1].gnss == GnssFix(8.4, 49.0, 110.0, 1.5, 0.7)
    assert trace[2].gnss is None
    assert np.array_equal(trace[3].left, np.asarray(trace[3].left))
    assert trace[3].left.shape == (48, 64, 3)


def test_part_of_a_trace_keeps_numbers_and_poses(folder: Path) -> None:
    trace = RecordedTrace(folder, frames=slice(1, None, 2))
    assert trace.frame_numbers.tolist() == [1, 3]
    assert trace[1].index == 3
    assert trace.ground_truth is not None
    assert trace.ground_truth.T_world_cam.shape == (2, 4, 4)


def test_the_truth_is_not_opened_unasked(folder: Path) -> None:
    (folder / "ground_truth" / "poses.txt").write_text("no numbers\n")
    trace = RecordedTrace(folder)
    assert trace[0].left.shape == (48, 64, 3)
    with pytest.raises(TraceError, match=r"poses\.txt"):
        _ = trace.ground_truth


def test_a_trace_without_truth(folder: Path) -> None:
    (folder / "ground_truth" / "poses.txt").unlink()
    assert RecordedTrace(folder).ground_truth is None
    assert RecordedTrace(folder).parking_map is None


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda d: d.update(version=9), "version 9"),
        (lambda d: d.update(format="other"), "not an index"),
        (lambda d: d["camera"].pop("fx"), "damaged"),
        (lambda d: d["camera"].update(baseline_m=-1.0), "damaged"),
        (lambda d: d["frames"][0].pop("timestamp"), "damaged"),
        (lambda d: d.update(frames=[]), "no images"),
    ],
)
def test_a_damaged_index_is_told(folder: Path, damage, complaint: str) -> None:  # type: ignore[no-untyped-def]
    document = json.loads((folder / "trace.json").read_text())
    damage(document)
    (folder / "trace.json").write_text(json.dumps(document))
    with pytest.raises(TraceError, match=complaint):
        open_trace(folder)


def test_a_missing_or_misshapen_image_is_told(folder: Path) -> None:
    image_path(folder, "right", 2).unlink()
    with pytest.raises(TraceError, match=r"000002\.png"):
        RecordedTrace(folder)[2]
    write_image(image_path(folder, "left", 1), np.zeros((10, 10), np.uint8))
    with pytest.raises(TraceError, match="10 x 10"):
        RecordedTrace(folder)[1]
