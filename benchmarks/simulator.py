"""The simulator's bars: realism in the eyes of a network that never saw it, features, speed, memory, determinism.

Realism needs YOLOv8n-seg weights (AGPL-3.0, not shipped): AUTOWAZE_COCO_WEIGHTS names the ONNX file.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from autowaze.simulator import SimulatedTrace, load_description, record
from autowaze.simulator.description import StreetDescription
from autowaze.simulator.simulated_trace import SimulatedFrame
from autowaze.vehicle.semantics.segmenter import Segmenter, load_segmenter
from autowaze.world.labels import VEHICLES, ClassLabel
from autowaze.world.pose import inverse, transform
from benchmarks import data

WEIGHTS = os.environ.get("AUTOWAZE_COCO_WEIGHTS", str(data.WEIGHTS))
FRAMES_PER_STREET = int(os.environ.get("AUTOWAZE_BENCH_FRAMES", "20"))
MIN_PIXELS = 1200
MIN_CONFIDENCE = 0.25
"""The usual threshold of YOLOv8's predictions."""
MATCH_PX = 2.0
CHI2_INLIER_PX = 2.447
"""95 % of a keypoint's reprojection errors, for a standard deviation of a pixel of its octave (ORB-SLAM2)."""
FAR_M = 150.0

STREETS = [
    ("town-a", {"drive": 1}),
    ("town-b", {"drive": 2, "light": {"solar_time": 10.0}}),
    ("gold", {"drive": 3, "rig": {"name": "kitti", "mount_height_m": 1.65}}),
    ("langslow", {"drive": 4, "rig": {"name": "kitti", "mount_height_m": 1.65}}),
    ("stewart", {"drive": 5}),
    ("lot-b", {"drive": 6}),
    ("loop", {"drive": 7, "light": {"weather": "hazy"}}),
    ("suburb", {"drive": 8}),
    ("high-street", {"drive": 9}),
    ("town-a", {"seed": 77, "drive": 10, "light": {"weather": "overcast", "wet": True}}),
]


@dataclass
class Tally:
    """Counts over all frames."""

    wanted: int = 0
    found: int = 0
    ious: list[float] = field(default_factory=list)
    detections: int = 0
    strange: int = 0
    stereo_within: list[bool] = field(default_factory=list)
    unconstrained_within: list[bool] = field(default_factory=list)
    motion_inlier: list[bool] = field(default_factory=list)
    motion_within: list[bool] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)


def run() -> None:
    """Print the table of bars."""
    tally = Tally()
    segmenter = load_segmenter(WEIGHTS, min_confidence=MIN_CONFIDENCE) if Path(WEIGHTS).is_file() else None
    wanted = sys.argv[2:] if len(sys.argv) > 2 else None
    for street, changes in STREETS:
        if wanted and street not in wanted:
            continue
        look_at(load_description(street, **changes), segmenter, tally)
    table = Table("bar", "measured", "wanted", title="simulator")
    if segmenter is not None:
        table.add_row(
            f"vehicles >= {MIN_PIXELS} px found at IoU > 0.5",
            f"{tally.found / tally.wanted:.3f} of {tally.wanted}",
            ">= 0.95",
        )
        table.add_row("mean mask IoU of those", f"{np.mean(tally.ious):.3f}", ">= 0.90")
        share = tally.strange / max(tally.detections, 1)
        table.add_row("vehicle detections that match none", f"{share:.3f} of {tally.detections}", "<= 0.05")
    else:
        table.add_row("realism", f"not measured: no {WEIGHTS}", ">= 0.95, >= 0.90, <= 0.05")
    table.add_row("ORB stereo matches within 2 px of truth", f"{np.mean(tally.stereo_within):.3f}", ">= 0.75")
    table.add_row("  the same, matched without the row constraint", f"{np.mean(tally.unconstrained_within):.3f}", "")
    table.add_row(
        "cross-checked matches that are inliers of the motion", f"{np.mean(tally.motion_inlier):.3f}", ">= 0.80"
    )
    table.add_row("  the same, within 2 px at every octave", f"{np.mean(tally.motion_within):.3f}", "")
    table.add_row("CPU per stereo pair with truth, median", f"{speed():.0f} ms", "<= 250 ms")
    table.add_row("memory of a process", f"{memory():.2f} GB", "<= 1.5 GB")
    same, different = determinism()
    table.add_row("same command twice", "identical files" if same else "files differ", "identical")
    table.add_row("pixels that another seed changes by > 20", f"{different:.2f}", "visibly different")
    console = Console(width=130)
    console.print(table)
    for line in tally.missed:
        console.print(line)


def look_at(description: StreetDescription, segmenter: Segmenter | None, tally: Tally) -> None:
    """Add frames of one street to the tally."""
    trace = SimulatedTrace(description)
    for index in np.linspace(0, len(trace) - 2, FRAMES_PER_STREET).astype(int):
        frame = trace.render(int(index))
        if segmenter is not None:
            _judge(trace, frame, segmenter, tally)
        _match(trace, frame, trace.render(int(index) + 1), tally)
    trace.close()


def _judge(trace: SimulatedTrace, frame: SimulatedFrame, segmenter: Segmenter, tally: Tally) -> None:
    labels = _labels(trace)
    detections = segmenter.segment(frame.stereo.left)
    vehicles = detections[np.isin(detections.label, VEHICLES)]
    ids, counts = np.unique(frame.ids[frame.ids > 0], return_counts=True)
    known = {int(i): int(n) for i, n in zip(ids, counts, strict=True) if labels[int(i)] in VEHICLES}
    areas = vehicles.mask.reshape(len(vehicles), -1).sum(axis=1) if len(vehicles) else np.zeros(0)
    any_vehicle = np.isin(frame.ids, list(known))
    on_vehicles = np.array([(mask & any_vehicle).sum() for mask in vehicles.mask]) / np.maximum(areas, 1)
    for id, pixels in known.items():
        truth = frame.ids == id
        overlap = (vehicles.mask & truth).reshape(len(vehicles), -1).sum(axis=1) if len(vehicles) else np.zeros(0)
        iou = overlap / np.maximum(areas + pixels - overlap, 1)
        if pixels >= MIN_PIXELS:
            tally.wanted += 1
            if len(iou) and iou.max() > 0.5:
                tally.found += 1
                tally.ious.append(float(iou.max()))
            else:
                where = np.argwhere(truth).mean(axis=0).astype(int)
                best = float(iou.max()) if len(iou) else 0.0
                at = f"{trace.name} frame {frame.stereo.index} id {id} at {where[::-1]}"
                tally.missed.append(f"missed: {at}, {pixels} px, best IoU {best:.2f}")
    tally.detections += len(vehicles)
    for i in np.flatnonzero(on_vehicles < 0.5):
        tally.strange += 1
        box = vehicles.box[i].astype(int)
        tally.missed.append(f"strange: {trace.name} frame {frame.stereo.index} box {box}")


def _labels(trace: SimulatedTrace) -> dict[int, ClassLabel]:
    things = [*trace.drive.still, *(actor.thing for actor in trace.drive.actors)]
    return {thing.id: thing.label for thing in things}


def _match(trace: SimulatedTrace, frame: SimulatedFrame, later: SimulatedFrame, tally: Tally) -> None:
    """ORB matches against the true depth and the true motion."""
    orb, matcher = cv2.ORB_create(2000), cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    features = [
        orb.detectAndCompute(image, None)
        for image in (frame.stereo.left_grey, frame.stereo.right_grey, later.stereo.left_grey)
    ]
    camera = trace.camera
    moving = np.isin(frame.ids, [actor.thing.id for actor in trace.drive.actors])

    def pairs(a: int, b: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        matches = matcher.match(features[a][1], features[b][1])
        return (
            np.array([features[a][0][m.queryIdx].pt for m in matches]),
            np.array([features[b][0][m.trainIdx].pt for m in matches]),
            np.array([float(features[a][0][m.queryIdx].octave) for m in matches]),
        )

    left, right, _ = pairs(0, 1)
    column, row = np.round(left).astype(int).T
    z = frame.depth[row, column]
    near = z < FAR_M
    expected = np.stack([left[:, 0] - camera.bf / z, left[:, 1]], -1)
    # a stereo match lies in one row of a rectified pair, to the right in the left image
    stereo = near & (np.abs(right[:, 1] - left[:, 1]) <= MATCH_PX) & (left[:, 0] > right[:, 0])
    tally.stereo_within += list(np.linalg.norm(right - expected, axis=1)[stereo] < MATCH_PX)
    tally.unconstrained_within += list(np.linalg.norm(right - expected, axis=1)[near] < MATCH_PX)
    now, then, octave = pairs(0, 2)
    column, row = np.round(now).astype(int).T
    z = frame.depth[row, column]
    usable = (z < FAR_M) & ~moving[row, column]
    points = transform(inverse(later.T_map_cam) @ frame.T_map_cam, camera.back_project(now[usable], z[usable]))
    error = np.linalg.norm(camera.project(points)[:, :2] - then[usable], axis=1)
    tally.motion_inlier += list(error < CHI2_INLIER_PX * orb.getScaleFactor() ** octave[usable])
    tally.motion_within += list(error < MATCH_PX)


def speed() -> float:
    """Median CPU milliseconds of a KITTI-sized pair with ids, depth and shadows."""
    trace = SimulatedTrace(load_description("town-a"))
    trace.render(0)
    spent = []
    for index in range(2, len(trace), max(1, len(trace) // 30)):
        start = time.process_time()
        trace.render(index)
        spent.append(time.process_time() - start)
    trace.close()
    return float(np.median(spent)) * 1e3


def memory() -> float:
    """Peak memory in GB of a fresh process that renders the street with the most cars."""
    code = (
        "from pathlib import Path; from autowaze.simulator import SimulatedTrace, load_description; "
        "SimulatedTrace(load_description('loop')).render(3); print(Path('/proc/self/status').read_text())"
    )
    output = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    [peak] = [line.split()[1] for line in output.splitlines() if line.startswith("VmHWM")]
    return int(peak) / 1024**2


def determinism() -> tuple[bool, float]:
    """Whether two runs write the same bytes, and how many pixels differ between two seeds."""
    with tempfile.TemporaryDirectory() as scratch:
        sums = []
        for name, workers in (("a", 1), ("b", 2)):
            record(load_description("town-a", ego={"frames": 16}), Path(scratch) / name, workers=workers)
            files = sorted(p for p in (Path(scratch) / name).rglob("*") if p.is_file())
            sums.append(
                [(p.relative_to(Path(scratch) / name), hashlib.sha256(p.read_bytes()).hexdigest()) for p in files]
            )
    pictures = [SimulatedTrace(load_description("suburb", seed=seed))[20].left.astype(int) for seed in (1, 2)]
    return sums[0] == sums[1], float((np.abs(pictures[0] - pictures[1]).max(axis=2) > 20).mean())
