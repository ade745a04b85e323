"""What is really to be seen in each frame of a labelled drive: simulated ones by the pixel, KITTI's by boxes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.traces import Trace
from autowaze.traces.kitti import KittiTrace
from autowaze.traces.kitti_labels import ObjectLabels, read_labels
from autowaze.traces.recorded import TRUTH_FOLDER, RecordedTrace, image_path
from autowaze.world.columns import Columns
from autowaze.world.errors import TraceError
from autowaze.world.instances import Detections
from autowaze.world.labels import ClassLabel, is_vehicle

MOVING_MPS, _MOVED_WITHIN_S = 0.5, 1.0
"""What has come no further than this in the last second stands, be it in traffic."""

_KITTI_LABELS, _KITTI_MOVING = "label_02.txt", "moving.json"
_KITTI_CLASSES = {
    "Car": ClassLabel.CAR,
    "Van": ClassLabel.CAR,
    "Truck": ClassLabel.TRUCK,
    "Tram": ClassLabel.BUS,
    "Cyclist": ClassLabel.TWO_WHEELER,
    "Pedestrian": ClassLabel.PERSON,
    "Person_sitting": ClassLabel.PERSON,
}
_MARGIN_X, _MARGIN_Y = 0.08, 0.12  # of a labelled box, where the street shows beside the thing


@dataclass
class TrueInstances(Columns):
    """Instances of one frame, N rows; ground truth, for evaluation only.

    Attributes:
        id: (N,) int64, holds over the drive.
        label: (N,) uint8, a `ClassLabel`.
        box: (N, 4) float32, left, top, right, bottom in pixels.
        mask: (N, H, W) bool; of a labelled box, its middle less what nearer boxes hide.
        pixels: (N,) int64, how many are seen of it; of a labelled box, all inside it.
        range_m: (N,) float64, horizontal distance of its centre from the camera; infinite where unknown.
        moving: (N,) bool.
    """

    id: NDArray[np.int64]
    label: NDArray[np.uint8]
    box: NDArray[np.float32]
    mask: NDArray[np.bool_]
    pixels: NDArray[np.int64]
    range_m: NDArray[np.float64]
    moving: NDArray[np.bool_]

    @property
    def vehicles(self) -> TrueInstances:
        """Those that can occupy a parking spot."""
        return self[is_vehicle(self.label)]

    def as_detections(self) -> Detections:
        """What a perfect network would find."""
        return Detections(self.box, self.label, np.ones(len(self), np.float32), self.mask)


class Truth(Protocol):
    """True instances of a drive."""

    @property
    def by_pixel(self) -> bool:
        """Whether masks are exact."""

    def instances(self, row: int) -> TrueInstances:
        """What the trace's frame number `row`, counted from the first frame in use, shows."""


def open_truth(folder: Path, trace: Trace) -> Truth:
    """The true instances of a drive.

    Raises:
        TraceError: the drive has none, or they are damaged.
    """
    if isinstance(trace, RecordedTrace):
        return SimulatedTruth(trace)
    if isinstance(trace, KittiTrace) and (folder / _KITTI_LABELS).is_file():
        return LabelledTruth(folder, trace)
    raise TraceError(
        f"{folder}: no true instances to compare with: expected {TRUTH_FOLDER}/ids of `autowaze simulate`, "
        f"or KITTI's tracking labels as {_KITTI_LABELS}"
    )


class SimulatedTruth:
    """By the simulator's images of instance ids, `vehicles.json` and `moving.json`."""

    by_pixel = True

    def __init__(self, trace: RecordedTrace) -> None:
        self._folder = trace.folder / TRUTH_FOLDER
        self._numbers = trace.frame_numbers
        self._shape = trace.camera.height, trace.camera.width
        poses = trace.ground_truth
        if poses is None:
            raise TraceError(f"{self._folder}: no poses of the camera")
        self._eye = poses.T_world_cam[:, :2, 3]
        still, moving = _read_json(self._folder / "vehicles.json"), _read_json(self._folder / "moving.json")
        self._label: dict[int, int] = {}
        self._standing: dict[int, NDArray[np.float64]] = {}
        self._tracks: dict[int, dict[int, NDArray[np.float64]]] = {}
        try:
            for row in [*still["vehicles"], *moving["other_still_instances"]]:
                self._label[row["id"]] = int(row["class"])
                self._standing[row["id"]] = np.array(row["center_xyz"][:2], np.float64)
            for row in moving["moving"]:
                self._label[row["id"]] = int(row["class"])
                self._tracks[row["id"]] = {p["frame"]: np.array(p["center_xyz"][:2], np.float64) for p in row["track"]}
        except (KeyError, TypeError, ValueError) as error:
            raise TraceError(f"{self._folder}: damaged vehicles.json or moving.json: {error}") from error
        times = RecordedTrace(trace.folder)
        self._time = dict(zip(times.frame_numbers.tolist(), times.timestamps.tolist(), strict=True))

    def instances(self, row: int) -> TrueInstances:
        """What a frame shows."""
        number = int(self._numbers[row])
        path = image_path(self._folder, "ids", number)
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is None or image.shape != self._shape:
            raise TraceError(f"{path}: missing or not an image of instance ids of {self._shape[1]} x {self._shape[0]}")
        ids = np.array([i for i in np.unique(image) if int(i) in self._label], np.int64)
        mask = np.asarray(image[None] == ids[:, None, None], np.bool_)
        centres = [self._centre(int(i), number) for i in ids]
        return TrueInstances(
            ids,
            np.array([self._label[int(i)] for i in ids], np.uint8),
            _boxes(mask),
            mask,
            mask.sum(axis=(1, 2)),
            np.array([np.inf if c is None else np.linalg.norm(c - self._eye[row]) for c in centres], np.float64),
            np.array([self._is_moving(int(i), number) for i in ids], np.bool_),
        )

    def _centre(self, instance: int, number: int) -> NDArray[np.float64] | None:
        track = self._tracks.get(instance)
        return self._standing.get(instance) if track is None else track.get(number)

    def _is_moving(self, instance: int, number: int) -> bool:
        """By how far it has come in the last second, or since it is there."""
        track = self._tracks.get(instance, {})
        now = self._time[number]
        recent = [n for n in track if n <= number and now - self._time.get(n, -np.inf) <= _MOVED_WITHIN_S + 1e-6]
        if len(recent) < 2:
            return bool(track)
        way = float(np.linalg.norm(track[max(recent)] - track[min(recent)]))
        return bool(way > MOVING_MPS * (self._time[max(recent)] - self._time[min(recent)]))


class LabelledTruth:
    """By KITTI's tracking labels, with the moving ones named in `moving.json` (`{"tracks": [{"track_id": …}]}`)."""

    by_pixel = False

    def __init__(self, folder: Path, trace: KittiTrace) -> None:
        self._labels = read_labels(folder / _KITTI_LABELS)
        self._labels = self._labels[np.isin(self._labels.kind, list(_KITTI_CLASSES))]
        self._numbers = trace.frame_numbers
        self._shape = trace.camera.height, trace.camera.width
        try:
            self._moving = {int(row["track_id"]) for row in _read_json(folder / _KITTI_MOVING)["tracks"]}
        except (KeyError, TypeError, ValueError) as error:
            raise TraceError(f"{folder / _KITTI_MOVING}: expected tracks with their track_id: {error}") from error

    def instances(self, row: int) -> TrueInstances:
        """What a frame shows."""
        rows = self._labels[self._labels.frame == self._numbers[row]]
        width, height = rows.box[:, 2] - rows.box[:, 0], rows.box[:, 3] - rows.box[:, 1]
        return TrueInstances(
            rows.track_id,
            np.array([_KITTI_CLASSES[str(kind)] for kind in rows.kind], np.uint8),
            rows.box.astype(np.float32),
            self._masks(rows),
            (width * height).astype(np.int64),
            np.linalg.norm(rows.position_cam[:, [0, 2]], axis=1),
            np.isin(rows.track_id, list(self._moving)),
        )

    def _masks(self, rows: ObjectLabels) -> NDArray[np.bool_]:
        masks = np.zeros((len(rows), *self._shape), np.bool_)
        for i in np.argsort(-rows.position_cam[:, 2]):
            x0, y0, x1, y1 = np.maximum(rows.box[i], 0.0)
            dx, dy = _MARGIN_X * (x1 - x0), _MARGIN_Y * (y1 - y0)
            masks[:, int(y0) : int(y1), int(x0) : int(x1)] = False
            masks[i, int(y0 + dy) : int(y1 - dy), int(x0 + dx) : int(x1 - dx)] = True
        return masks


def all_instances(truth: Truth, frames: int) -> Iterator[TrueInstances]:
    """True instances of each frame, one after the other."""
    return (truth.instances(row) for row in range(frames))


def _boxes(masks: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Boxes (N, 4) around masks (N, H, W), none of them empty."""
    boxes = np.zeros((len(masks), 4), np.float32)
    for box, mask in zip(boxes, masks, strict=True):
        columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
        box[:] = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
    return boxes


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise TraceError(f"{path}: cannot be read: {error}") from error
