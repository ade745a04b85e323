"""Spots against truth: the thesis's precision, recall and accuracy with vacant as positive (sec. 4.1.3)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from autowaze.cloud.methods import ORB_SLAM2
from autowaze.cloud.service import CloudService
from autowaze.evaluation.datum import Start, starting_point
from autowaze.evaluation.drive import Progress, run_drive
from autowaze.evaluation.full_map import FullMapUpload
from autowaze.traces import Trace
from autowaze.vehicle.node import VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.errors import AutowazeError
from autowaze.world.parking import Occupancy, ParkingMap, SpotState
from autowaze.world.wire import decode_diff


@dataclass(frozen=True)
class SpotTruth:
    """What is true of one spot, and whether the drive could see it."""

    spot_id: str
    occupied: bool
    observable: bool


@dataclass(frozen=True)
class Confusion:
    """Counts over observable spots; `unknown` for one of them is an error.

    Attributes:
        true_vacant, true_occupied: right answers.
        false_vacant: occupied spots called vacant.
        false_occupied: vacant spots called occupied.
        unknown_vacant, unknown_occupied: spots without an answer, by what they are.
        unobservable_vacant: spots that count as not observable and were called vacant all the same.
    """

    true_vacant: int = 0
    true_occupied: int = 0
    false_vacant: int = 0
    false_occupied: int = 0
    unknown_vacant: int = 0
    unknown_occupied: int = 0
    unobservable_vacant: int = 0

    def __add__(self, other: Confusion) -> Confusion:
        mine, theirs = vars(self), vars(other)
        return Confusion(**{name: mine[name] + theirs[name] for name in mine})

    @property
    def total(self) -> int:
        """Observable spots."""
        return int(sum(vars(self).values())) - self.unobservable_vacant

    @property
    def precision(self) -> float:
        """Share of the spots called vacant that are; 1 when none was."""
        return _ratio(self.true_vacant, self.true_vacant + self.false_vacant)

    @property
    def recall(self) -> float:
        """Share of the vacant spots that were called so; 1 when there are none."""
        return _ratio(self.true_vacant, self.true_vacant + self.false_occupied + self.unknown_vacant)

    @property
    def accuracy(self) -> float:
        """Share of right answers."""
        return _ratio(self.true_vacant + self.true_occupied, self.total)

    def metrics(self) -> dict[str, float]:
        """Flat names for reports."""
        scores = {"precision": self.precision, "recall": self.recall, "accuracy": self.accuracy}
        return {**scores, "spots": float(self.total), **{k: float(v) for k, v in vars(self).items()}}


def read_truth(path: str | Path) -> list[SpotTruth]:
    """Read a JSON object of spot id to {"occupied": bool, "observable": bool}, or one that holds it as "spots".

    Raises:
        AutowazeError: the file is missing or of another shape.
    """
    path = Path(path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        document = document.get("spots", document)
        return [SpotTruth(key, bool(v["occupied"]), bool(v["observable"])) for key, v in document.items()]
    except OSError as error:
        raise AutowazeError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, AttributeError, KeyError, TypeError) as error:
        message = f"{path}: expected a JSON object of spot id to occupied and observable"
        raise AutowazeError(message) from error


def confusion(states: Iterable[SpotState], truth: Iterable[SpotTruth]) -> Confusion:
    """Count right and wrong answers.

    Raises:
        AutowazeError: a spot of the truth is not on the parking map.
    """
    answers = {state.spot_id: state.occupancy for state in states}
    counts = Confusion()
    for spot in truth:
        if spot.spot_id not in answers:
            raise AutowazeError(f"spot {spot.spot_id} of the truth is not on the parking map: use files of one place")
        counts += _one(answers[spot.spot_id], spot)
    return counts


def judge_trace(
    trace: Trace,
    spots: ParkingMap,
    truth: Sequence[SpotTruth],
    methods: Sequence[str],
    segmenter: Segmenter,
    start: Start,
    progress: Progress | None = None,
) -> dict[str, Confusion]:
    """One drive with an empty map, judged by every method; `orb-slam2` is sent the whole map instead of diffs."""
    node = VehicleNode(trace.camera, segmenter, start=starting_point(trace, spots, start), session=1, spots=spots)
    upload, diffs, whole_map = FullMapUpload(), list[bytes](), list[bytes]()

    def receive(message: bytes) -> None:
        diffs.append(message)
        whole_map[:] = upload.after_window(node.slam.landmarks, decode_diff(message))

    run_drive(trace, node, receive, progress)
    found = {}
    for name in methods:
        cloud = CloudService(spots, name)
        for message in whole_map if cloud.method == ORB_SLAM2 else diffs:
            cloud.receive(message)
        found[name] = confusion(cloud.states, truth)
    return found


def _one(answer: Occupancy, spot: SpotTruth) -> Confusion:
    if not spot.observable:
        return Confusion(unobservable_vacant=int(answer is Occupancy.VACANT))
    if answer is Occupancy.UNKNOWN:
        return Confusion(unknown_occupied=1) if spot.occupied else Confusion(unknown_vacant=1)
    if answer is Occupancy.VACANT:
        return Confusion(false_vacant=1) if spot.occupied else Confusion(true_vacant=1)
    return Confusion(true_occupied=1) if spot.occupied else Confusion(false_occupied=1)


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else 1.0
