"""Times of the semantic stages and of the ground grid on a real drive."""

import time
from collections import defaultdict

import numpy as np

from autowaze.traces import open_trace
from autowaze.vehicle.ground import GroundObserver
from autowaze.vehicle.ground_grid import GroundGrid
from autowaze.vehicle.semantics.association import associate
from autowaze.vehicle.semantics.instance_depth import measure_depths
from autowaze.vehicle.semantics.motion import MotionClassifier
from autowaze.vehicle.semantics.propagation import propagate
from autowaze.vehicle.semantics.segmenter import load_segmenter
from autowaze.vehicle.semantics.sort import Sort
from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.world.pose import heading_to_rotation, make_pose
from benchmarks.data import KITTI, WEIGHTS

_FRAMES = 40
T_MAP_WORLD = make_pose(heading_to_rotation(0.0), np.zeros(3))


def run() -> None:
    trace = open_trace(KITTI / "drive_0005")
    segmenter = load_segmenter(WEIGHTS)
    extractor, sort, motion = FeatureExtractor(trace.camera), Sort(trace.camera), MotionClassifier(trace.camera)
    observer, grid = GroundObserver(trace.camera), GroundGrid()
    times = defaultdict(list)

    def timed(stage, function, *args):
        start = time.perf_counter()
        result = function(*args)
        times[stage].append(1e3 * (time.perf_counter() - start))
        return result

    before = None
    for k in range(max(len(trace) - _FRAMES, 0), len(trace)):
        frame, T_map_cam = trace[k], T_MAP_WORLD @ trace.ground_truth.T_world_cam[k]
        features = extractor.extract(frame)
        detections = timed("segment", segmenter.segment, frame.left)
        if before is not None:
            timed("propagate", propagate, before[1], before[0], frame.left_grey)
        depths = timed("instance depth", measure_depths, features, detections)
        tracks = timed("track", sort.update, detections, T_map_cam, depths)
        labelled = timed("associate", associate, features, tracks)
        timed("motion", motion.update, labelled, T_map_cam, frame.timestamp, tracks)
        disparity = timed("disparity", observer.disparity, frame)
        seen = timed("ground cells", observer.cells_of, disparity, T_map_cam)
        timed("ground grid", grid.add, seen)
        before = frame.left_grey, detections
    print(f"{'stage':16}{'median ms':>10}{'p95 ms':>10}")
    for stage, values in times.items():
        print(f"{stage:16}{np.median(values[2:]):10.1f}{np.percentile(values[2:], 95):10.1f}")
