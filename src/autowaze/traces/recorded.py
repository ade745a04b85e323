"""Autowaze's own trace format, version 1: what the simulator writes, and any recorder may.

    TRACE/
      trace.json            format, version, camera, and per frame its number, time and GNSS fix
      left/000000.png       8-bit grey or BGR, rectified
      right/000000.png
      parking_map.geojson   the spots along the way, if known
      streets.geojson       streets and buildings for people to look at, if known
      ground_truth/         opened by evaluation only; poses.txt holds one T_map_cam (3 x 4, row by row) per frame

`trace.json` is written last, so a folder without it is a recording that was cut short.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.traces.trace import GroundTruth
from autowaze.world.camera import StereoCamera
from autowaze.world.errors import AutowazeError, TraceError
from autowaze.world.frame import GnssFix, Image, StereoFrame

FORMAT, VERSION = "autowaze-trace", 1
INDEX, PARKING_MAP, STREETS = "trace.json", "parking_map.geojson", "streets.geojson"
TRUTH_FOLDER, POSES = "ground_truth", "poses.txt"
_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]
"""Fast: noise does not get smaller by trying harder."""


@dataclass(frozen=True)
class FrameEntry:
    """One frame in the index of a trace."""

    index: int
    timestamp: float
    gnss: GnssFix | None = None


class RecordedTrace:
    """A drive in Autowaze's own format as a `Trace`.

    Ground truth poses, where there are any, are T_map_cam in east, north, up metres of the trace's georeference; the
    truth folder is opened when they are asked for, never before.
    """

    def __init__(self, folder: str | Path, frames: slice | None = None) -> None:
        self.folder = Path(folder)
        self.camera, entries = _read_index(self.folder / INDEX)
        numbers = range(len(entries)) if frames is None else range(*frames.indices(len(entries)))
        self._rows = list(numbers)
        self._entries = [entries[row] for row in self._rows]
        if not self._entries:
            raise TraceError(f"{self.folder}: no images among the frames asked for")

    @staticmethod
    def recognises(folder: Path) -> bool:
        """Whether the folder holds a finished trace of this format."""
        return (folder / INDEX).is_file()

    @property
    def name(self) -> str:
        """Folder name."""
        return self.folder.name

    @property
    def frame_numbers(self) -> NDArray[np.int64]:
        """Numbers of the frames, (N,)."""
        return np.array([entry.index for entry in self._entries], dtype=np.int64)

    @property
    def timestamps(self) -> NDArray[np.float64]:
        """Times of the frames, (N,) seconds."""
        return np.array([entry.timestamp for entry in self._entries], dtype=np.float64)

    @property
    def parking_map(self) -> Path | None:
        """The GeoJSON file of the spots along the way, if the trace brings one."""
        path = self.folder / PARKING_MAP
        return path if path.is_file() else None

    @cached_property
    def ground_truth(self) -> GroundTruth | None:
        """Poses of the left camera, if the trace knows them."""
        path = self.folder / TRUTH_FOLDER / POSES
        if not path.is_file():
            return None
        try:
            rows = np.loadtxt(path, ndmin=2)
        except (OSError, ValueError) as error:
            raise TraceError(f"{path}: expected rows of 12 numbers: {error}") from error
        if rows.shape[1] != 12 or len(rows) <= max(self._rows) or not np.isfinite(rows).all():
            raise TraceError(f"{path}: expected 12 finite numbers for each of the trace's frames")
        poses = np.tile(np.eye(4), (len(self._rows), 1, 1))
        poses[:, :3] = rows[self._rows].reshape(-1, 3, 4)
        return GroundTruth(poses, in_map_frame=True)

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[StereoFrame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> StereoFrame:
        entry = self._entries[index]
        left, right = (self._read(image_path(self.folder, side, entry.index)) for side in ("left", "right"))
        return StereoFrame(entry.index, entry.timestamp, left, right, entry.gnss)

    def _read(self, path: Path) -> Image:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise TraceError(f"{path}: missing or not a readable image")
        if image.dtype != np.uint8 or image.shape[:2] != (self.camera.height, self.camera.width):
            raise TraceError(
                f"{path}: {image.shape[1]} x {image.shape[0]} {image.dtype}, the trace's camera has "
                f"{self.camera.width} x {self.camera.height} uint8"
            )
        return np.asarray(image, dtype=np.uint8)


def image_path(folder: Path, side: str, index: int) -> Path:
    """Where an image of a frame lies; `side` is "left", "right" or a folder of the ground truth."""
    return folder / side / f"{index:06d}.png"


def write_image(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write a PNG, whole or not at all."""
    done, encoded = cv2.imencode(".png", image, _PNG)
    if not done:
        raise TraceError(f"{path}: cannot encode an image of {image.shape} {image.dtype}")
    write_bytes(path, encoded.tobytes())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all."""
    partial = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        raise TraceError(f"{path}: cannot be written: {error.strerror}") from error


def write_index(folder: Path, camera: StereoCamera, entries: Sequence[FrameEntry]) -> None:
    """Write `trace.json`, which makes the folder a trace."""
    frames = []
    for entry in entries:
        row: dict[str, Any] = {"index": entry.index, "timestamp": entry.timestamp}
        if entry.gnss is not None:
            row["gnss"] = asdict(entry.gnss)
        frames.append(row)
    document = {"format": FORMAT, "version": VERSION, "camera": asdict(camera), "frames": frames}
    write_bytes(folder / INDEX, (json.dumps(document, indent=1) + "\n").encode())


def write_poses(folder: Path, T_map_cam: NDArray[np.float64]) -> None:
    """Write the poses (N, 4, 4) of the left camera into the truth folder."""
    lines = "\n".join(" ".join(f"{v:.9g}" for v in pose[:3].ravel()) for pose in T_map_cam)
    write_bytes(folder / TRUTH_FOLDER / POSES, (lines + "\n").encode())


def _read_index(path: Path) -> tuple[StereoCamera, list[FrameEntry]]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise TraceError(f"{path}: unreadable index of a trace: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise TraceError(f'{path}: not an index of a trace: "format" is not "{FORMAT}"')
    if document.get("version") != VERSION:
        raise TraceError(
            f"{path}: version {document.get('version')} of the format; this program reads version {VERSION}"
        )
    try:
        camera = StereoCamera(**document["camera"])
        entries = [
            FrameEntry(int(row["index"]), float(row["timestamp"]), GnssFix(**row["gnss"]) if "gnss" in row else None)
            for row in document["frames"]
        ]
    except (KeyError, TypeError, ValueError, AutowazeError) as error:
        raise TraceError(f"{path}: damaged index of a trace: {error}") from error
    return camera, entries
