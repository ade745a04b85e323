"""Where benchmarks find real drives and weights; they lie outside the repository."""

import os
from pathlib import Path

TEST_DATA = Path(os.environ.get("AUTOWAZE_TEST_DATA", Path(__file__).parents[2] / "shared"))
KITTI = TEST_DATA / "data" / "kitti"
DRIVES = (KITTI / "odometry_00", KITTI / "drive_0005")
WEIGHTS = TEST_DATA / "weights" / "yolov8n-seg.onnx"
