"""One drive of an experiment through the car: frames in, what it sent out, kept in files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from autowaze.evaluation.base_map import SURVEY, correct_survey
from autowaze.evaluation.drive import DriveRecord, Progress, run_drive
from autowaze.evaluation.full_map import FullMapUpload
from autowaze.evaluation.localization import localization_errors
from autowaze.traces import Trace
from autowaze.vehicle.diffing import FrameObservation
from autowaze.vehicle.ground_grid import GroundGrid
from autowaze.vehicle.node import NodeSettings, StartingPoint, VehicleNode
from autowaze.vehicle.semantics.segmenter import Segmenter
from autowaze.world.errors import AutowazeError
from autowaze.world.feature_map import FeatureMap
from autowaze.world.frame import StereoFrame
from autowaze.world.ground import GroundCells
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import ParkingMap
from autowaze.world.wire import decode_diff

WIDE_GROUND_M = 2.5
"""Around every spot the ground is kept so far, for experiments with a map that is off."""
SUMMARY = "summary.json"


@dataclass
class Passage:
    """What one drive left behind.

    Attributes:
        messages: the diffs as sent.
        full_map: messages that hold the whole map at the end of the drive, for the baseline that sends it.
        full_map_sizes: bytes of the whole map at the end of each window.
        wide_ground: per window the ground within `WIDE_GROUND_M` of every spot.
        metrics: distance, localisation against the truth, times.
        stage_ms: milliseconds of every frame by stage of the car.
    """

    messages: list[bytes] = field(default_factory=list)
    full_map: list[bytes] = field(default_factory=list)
    full_map_sizes: list[int] = field(default_factory=list)
    wide_ground: list[GroundCells] = field(default_factory=list)
    metrics: dict[str, float] = field(default_factory=dict)
    stage_ms: dict[str, list[float]] = field(default_factory=dict)
    path: list[list[float]] = field(default_factory=list)

    @property
    def diffs(self) -> Iterator[SemanticMapDiff]:
        """The diffs decoded."""
        return map(decode_diff, self.messages)

    def save(self, folder: Path, made_with: dict[str, Any]) -> None:
        """Write it; the summary last, which says that the folder is complete."""
        folder.mkdir(parents=True, exist_ok=True)
        for number, message in enumerate(self.messages):
            (folder / f"diff-{number:02d}.bin").write_bytes(message)
        for number, message in enumerate(self.full_map):
            (folder / f"full-map-{number:02d}.bin").write_bytes(message)
        for number, cells in enumerate(self.wide_ground):
            np.savez_compressed(folder / f"ground-{number:02d}.npz", **asdict(cells))
        summary = {
            "made_with": made_with,
            "diffs": len(self.messages),
            "full_map": len(self.full_map),
            "full_map_sizes": self.full_map_sizes,
            "metrics": self.metrics,
            "stage_ms": self.stage_ms,
            "path": self.path,
        }
        part = folder / f"{SUMMARY}.part"
        part.write_text(json.dumps(summary), encoding="utf-8")
        part.replace(folder / SUMMARY)

    @classmethod
    def load(cls, folder: Path, made_with: dict[str, Any]) -> Passage | None:
        """Read it back; None where there is none, or one that was made with something else."""
        try:
            summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
            if summary["made_with"] != made_with:
                return None
            messages = [(folder / f"diff-{n:02d}.bin").read_bytes() for n in range(summary["diffs"])]
            full_map = [(folder / f"full-map-{n:02d}.bin").read_bytes() for n in range(summary["full_map"])]
            ground = []
            for number in range(len(messages)):
                path = folder / f"ground-{number:02d}.npz"
                if path.is_file():
                    with np.load(path, allow_pickle=False) as columns:
                        ground.append(GroundCells(**columns))
            return cls(
                messages,
                full_map,
                summary["full_map_sizes"],
                ground,
                summary["metrics"],
                summary["stage_ms"],
                summary["path"],
            )
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise AutowazeError(f"{folder}: no stored drive: {error}; remove the folder to drive again") from error


def survey_passage(
    trace: Trace,
    segmenter: Segmenter,
    start: StartingPoint,
    session: int,
    progress: Progress | None = None,
    spots: ParkingMap | None = None,
) -> Passage:
    """The drive that the base map is made of: no map is known, nothing has to be sent by radio."""
    node = VehicleNode(trace.camera, segmenter, NodeSettings(diff=SURVEY), start=start, session=session)
    record = run_drive(trace, node, lambda message: None, progress)
    correct_survey(record, node, trace.camera, start, spots)
    return _passage(record, node, trace)


def drive_passage(
    trace: Trace,
    segmenter: Segmenter,
    spots: ParkingMap,
    start: StartingPoint,
    stored_map: FeatureMap | None,
    session: int,
    progress: Progress | None = None,
) -> Passage:
    """A drive as any car makes it, with the stored map and the parking map, and the first GNSS fix."""
    node = VehicleNode(trace.camera, segmenter, stored_map=stored_map, start=start, session=session, spots=spots)
    whole, full_map = FullMapUpload(), list[bytes]()
    wide = shapely.union_all(shapely.buffer(np.array([s.polygon for s in spots.spots], np.object_), WIDE_GROUND_M))
    shapely.prepare(wide)
    grids = [GroundGrid(wide)]

    def watch(frame: StereoFrame, observation: FrameObservation) -> None:
        if observation.ground is not None:
            grids[-1].add(observation.ground)

    def receive(message: bytes) -> None:
        full_map[:] = whole.after_window(node.slam.landmarks, decode_diff(message))
        grids.append(GroundGrid(wide))

    record = run_drive(trace, node, receive, progress, watch)
    passage = _passage(record, node, trace)
    passage.full_map, passage.full_map_sizes = full_map, whole.sizes
    passage.wide_ground = [grid.classes() for grid in grids[: len(record.messages)]]
    return passage


def _passage(record: DriveRecord, node: VehicleNode, trace: Trace) -> Passage:
    metrics = {
        "frames": float(len(record.tracked)),
        "distance_m": record.distance_m,
        "localized_fraction": record.localized_fraction,
    }
    if trace.ground_truth is not None and trace.ground_truth.in_map_frame:
        metrics |= localization_errors(record.tracked, trace.ground_truth.T_world_cam).metrics()
    stages = {name: [round(ms, 3) for ms in times] for name, times in node.times.milliseconds.items()}
    path = [[round(float(v), 3) for v in position] for position in record.T_map_cam[:, :3, 3]]
    return Passage(record.messages, metrics=metrics, stage_ms=stages, path=path)
