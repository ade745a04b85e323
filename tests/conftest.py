"""Where the tests find real drives and weights; read in place, never copied."""

import os
from pathlib import Path

import pytest

TEST_DATA = Path(os.environ.get("AUTOWAZE_TEST_DATA", Path(__file__).parents[2] / "shared"))


@pytest.fixture(scope="session")
def test_data() -> Path:
    """The folder of real drives and weights."""
    if not TEST_DATA.is_dir():
        pytest.skip(f"no test data at {TEST_DATA}: set AUTOWAZE_TEST_DATA")
    return TEST_DATA


@pytest.fixture(scope="session")
def kitti(test_data: Path) -> Path:
    return test_data / "data" / "kitti"


@pytest.fixture(scope="session")
def yolo_weights(test_data: Path) -> Path:
    return test_data / "weights" / "yolov8n-seg.onnx"
