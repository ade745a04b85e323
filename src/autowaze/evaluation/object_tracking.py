"""A whole car driven over a labelled drive: do ids hold, and does it know what is parked and what moves?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from autowaze.evaluation.drive import Progress, run_drive
from autowaze.evaluation.tracking import MIN_IOU, TrackingScore, box_iou
from autowaze.evaluation.true_instances import TrueInstances, Truth, all_instances
from autowaze.traces import Trace
from autowaze.vehicle.diffing import FrameObservation
from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.semantics.motion import Motions
from autowaze.world.frame import Image, StereoFrame
from autowaze.world.instances import Detections, Tracks
from autowaze.world.labels import is_vehicle

MOTION_RANGE_M, MOTION_SEEN_S = 25.0, 1.0
"""Whether a vehicle is parked is asked once it has been seen for so long, within so many metres."""
_LONGEST_GAP_S = 0.5  # between frames, to count as having been looked at


class OracleBoxes:
    """A segmenter that returns what is truly there; never part of what is evaluated, but a stand-in for the network.

    It is asked once per frame, in order.
    """

    name = "oracle boxes"

    def __init__(self, truth: Iterator[TrueInstances], min_pixels: int = 0) -> None:
        self._truth = truth
        self._min_pixels = min_pixels

    def segment(self, image: Image) -> Detections:
        """The true instances of the next frame that are large enough."""
        instances = next(self._truth)
        return instances[instances.pixels >= self._min_pixels].as_detections()


def oracle_boxes(truth: Truth, trace: Trace, min_pixels: int = 0) -> OracleBoxes:
    """A network that makes no mistake on this trace."""
    return OracleBoxes(all_instances(truth, len(trace)), min_pixels)


@dataclass
class MotionScore:
    """Verdicts on vehicles that have been seen long enough, near enough; one per vehicle and frame."""

    right: dict[bool, int] = field(default_factory=lambda: {True: 0, False: 0})
    wrong: dict[bool, int] = field(default_factory=lambda: {True: 0, False: 0})
    unjudged: int = 0
    last: dict[int, bool] = field(default_factory=dict)
    _seen_s: dict[int, float] = field(default_factory=dict)
    _before: float | None = None

    def add(self, timestamp: float, truth: TrueInstances, track_id: NDArray[np.int64], motions: Motions) -> None:
        """Take in one frame: vehicles, the id of the track on each (0 for none), and what the car says of tracks."""
        step = 0.0 if self._before is None else min(timestamp - self._before, _LONGEST_GAP_S)
        self._before = timestamp
        verdicts = dict(zip(motions.id.tolist(), motions.moving.tolist(), strict=True))
        near = truth.range_m <= MOTION_RANGE_M
        for vehicle, moves, track in zip(
            truth.id[near].tolist(), truth.moving[near].tolist(), track_id[near].tolist(), strict=True
        ):
            self._seen_s[vehicle] = self._seen_s.get(vehicle, -step) + step
            if self._seen_s[vehicle] < MOTION_SEEN_S - 1e-6:
                continue
            if track not in verdicts:
                self.unjudged += 1
                continue
            correct = verdicts[track] == moves
            (self.right if correct else self.wrong)[moves] += 1
            self.last[vehicle] = correct

    def metrics(self) -> dict[str, float]:
        """Shares that are right: of all verdicts, of those on moving and on parked vehicles, of last verdicts."""
        right, wrong = sum(self.right.values()), sum(self.wrong.values())
        scores = {
            "motion_verdicts": float(right + wrong),
            "motion_unjudged": float(self.unjudged),
            "motion_right": right / max(right + wrong, 1),
        }
        for moves, name in ((True, "moving_right"), (False, "parked_right")):
            if asked := self.right[moves] + self.wrong[moves]:
                scores[name] = self.right[moves] / asked
        if self.last:
            scores["motion_vehicles"] = float(len(self.last))
            scores["motion_last_right"] = float(np.mean(list(self.last.values())))
        return scores


class ObjectTrackingScore:
    """Tracks and verdicts of a drive against its true vehicles; watches `run_drive`.

    Vehicles of fewer than `min_pixels`, and whatever is no vehicle, count neither way: not finding them is no fault,
    and a track that follows one of them is no false alarm. Nor is a track of fewer pixels that follows nothing, as COCO
    leaves out what is found beyond the sizes asked for.
    """

    def __init__(self, truth: Iterator[TrueInstances], min_pixels: int) -> None:
        self.tracking = TrackingScore()
        self.motion = MotionScore()
        self._truth = truth
        self._min_pixels = min_pixels

    def watch(self, frame: StereoFrame, observation: FrameObservation) -> None:
        """Take in the next frame."""
        self.add(frame.timestamp, next(self._truth), observation.tracks, observation.motions)

    def add(self, timestamp: float, truth: TrueInstances, tracks: Tracks, motions: Motions) -> None:
        """Take in the next frame's truth, tracks and verdicts."""
        tracks = tracks[is_vehicle(tracks.label)]
        asked = is_vehicle(truth.label) & (truth.pixels >= self._min_pixels)
        partner = _partners(truth.box, tracks.box)
        followed = np.isin(np.arange(len(tracks)), partner[~asked & (partner >= 0)])
        following = np.isin(np.arange(len(tracks)), partner[asked])
        small = tracks.mask.sum(axis=(1, 2)) < self._min_pixels
        vehicles, kept = truth[asked], tracks[following | ~(followed | small)]
        self.tracking.add(vehicles.id, vehicles.box, kept.id, kept.box)
        track_id = np.append(tracks.id, 0)[partner[asked]].astype(np.int64)
        self.motion.add(timestamp, vehicles, track_id, motions)

    def metrics(self) -> dict[str, float]:
        """Scores over all frames, by flat names."""
        return {**self.tracking.metrics(), **self.motion.metrics()}


def evaluate_object_tracking(
    trace: Trace, truth: Truth, node: VehicleNode, min_pixels: int, progress: Progress | None = None
) -> dict[str, float]:
    """Drive the trace and score what the car says of vehicles; see `ObjectTrackingScore`."""
    score = ObjectTrackingScore(all_instances(truth, len(trace)), min_pixels)
    run_drive(trace, node, lambda message: None, progress, score.watch)
    return score.metrics()


def _partners(true_box: NDArray[np.float32], track_box: NDArray[np.float32]) -> NDArray[np.int64]:
    """Row (T,) of the track on each true box, -1 for none; one to one, so that the total overlap is greatest."""
    overlap = box_iou(true_box, track_box)
    t, n = linear_sum_assignment(np.where(overlap >= MIN_IOU, overlap, 0.0), maximize=True)
    good = overlap[t, n] >= MIN_IOU
    partner = np.full(len(true_box), -1, np.int64)
    partner[t[good]] = n[good]
    return partner
