"""KITTI drives: the odometry and the raw layout, grey or colour pair.

Layouts as published with the dataset (cvlibs.net, Geiger et al. 2013).
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.traces.trace import GroundTruth
from autowaze.world.camera import StereoCamera
from autowaze.world.errors import TraceError
from autowaze.world.frame import GnssFix, Image, StereoFrame
from autowaze.world.pose import make_pose

_PAIRS = {"grey": (0, 1), "colour": (2, 3)}
_OXTS_LAT, _OXTS_LON, _OXTS_ALT, _OXTS_YAW, _OXTS_POS_ACCURACY = 0, 1, 2, 5, 23


class KittiTrace:
    """A KITTI drive as a `Trace`.

    Frames are numbered by their file names, so that parts of a drive keep their numbers. Poses, where there is a
    `poses.txt`, are those of the chosen pair's left camera in the frame of the file (x right, y down, z forward).
    """

    def __init__(self, folder: str | Path, cameras: str = "auto", frames: slice | None = None) -> None:
        self.folder = Path(folder)
        self._raw = (self.folder / "image_00").is_dir() or (self.folder / "image_02").is_dir()
        self._pair = self._choose_pair(cameras)
        self._left, self._right = self._paired_files(frames)
        projections = _read_calibration(self._calibration_file(), self._raw)
        size = self._read(self._left[0]).shape
        self.camera, self._T_reference_left = _stereo_camera(
            self._calibration_file(), projections, self._pair, (size[1], size[0])
        )
        self._timestamps = self._read_timestamps()
        self._oxts = sorted((self.folder / "oxts" / "data").glob("*.txt"))
        self.ground_truth = self._read_poses()

    @staticmethod
    def recognises(folder: Path) -> bool:
        """Whether the folder has the shape of a KITTI drive."""
        return any((folder / f"image_{n}").is_dir() for n in (0, 2)) or any(
            (folder / f"image_0{n}" / "data").is_dir() for n in (0, 2)
        )

    @property
    def name(self) -> str:
        """Folder name, with the pair when it is not the grey one."""
        return self.folder.name if self._pair == _PAIRS["grey"] else f"{self.folder.name}:colour"

    def __len__(self) -> int:
        return len(self._left)

    def __iter__(self) -> Iterator[StereoFrame]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> StereoFrame:
        left, right = self._left[index], self._right[index]
        number = int(left.stem)
        return StereoFrame(
            index=number,
            timestamp=self._timestamp(number),
            left=self._read_sized(left),
            right=self._read_sized(right),
            gnss=self._gnss(number),
        )

    @property
    def frame_numbers(self) -> NDArray[np.int64]:
        """File numbers of the frames, (N,)."""
        return np.array([int(path.stem) for path in self._left], dtype=np.int64)

    def _image_folder(self, camera: int) -> Path:
        return self.folder / (f"image_0{camera}/data" if self._raw else f"image_{camera}")

    def _choose_pair(self, cameras: str) -> tuple[int, int]:
        if cameras == "auto":
            present = [p for p in _PAIRS.values() if all(self._image_folder(c).is_dir() for c in p)]
            if not present:
                raise TraceError(f"{self.folder}: no complete stereo pair; need image_0 + image_1 or image_2 + image_3")
            return present[0]
        if cameras not in _PAIRS:
            raise TraceError(f"unknown camera pair {cameras!r}: use grey, colour or auto")
        for camera in _PAIRS[cameras]:
            if not self._image_folder(camera).is_dir():
                raise TraceError(f"{self._image_folder(camera)}: missing, so this drive has no {cameras} pair")
        return _PAIRS[cameras]

    def _paired_files(self, frames: slice | None) -> tuple[list[Path], list[Path]]:
        left_folder, right_folder = (self._image_folder(c) for c in self._pair)
        lefts = sorted(p for p in left_folder.iterdir() if p.suffix in {".png", ".jpg"} and p.stem.isdecimal())
        if frames is not None:
            start, stop = frames.start or 0, 1 << 62 if frames.stop is None else frames.stop
            step = frames.step or 1
            lefts = [p for p in lefts if start <= int(p.stem) < stop and (int(p.stem) - start) % step == 0]
        if not lefts:
            raise TraceError(f"{left_folder}: no images among the frames asked for")
        rights = [right_folder / path.name for path in lefts]
        for right in rights:
            if not right.is_file():
                raise TraceError(
                    f"{right}: missing, its left image is there; complete the drive or choose other frames"
                )
        return lefts, rights

    def _calibration_file(self) -> Path:
        name = "calib_cam_to_cam.txt" if self._raw else "calib.txt"
        for folder in (self.folder, self.folder.parent):
            if (folder / name).is_file():
                return folder / name
        raise TraceError(f"{self.folder / name}: missing; copy the drive's calibration there")

    def _read(self, path: Path) -> Image:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise TraceError(f"{path}: not a readable image")
        if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
            raise TraceError(f"{path}: expected an 8-bit grey or BGR image, found {image.dtype} {image.shape}")
        return np.asarray(image, dtype=np.uint8)

    def _read_sized(self, path: Path) -> Image:
        image = self._read(path)
        if image.shape[:2] != (self.camera.height, self.camera.width):
            raise TraceError(
                f"{path}: {image.shape[1]} x {image.shape[0]} pixels, the drive's first image has "
                f"{self.camera.width} x {self.camera.height}"
            )
        return image

    def _read_timestamps(self) -> NDArray[np.float64] | None:
        """Seconds by frame number, or None where the drive has no clock."""
        if self._raw:
            path = self.folder / f"image_0{self._pair[0]}" / "timestamps.txt"
            if not path.is_file():
                return None
            try:
                return np.array([_parse_kitti_time(line) for line in path.read_text().split("\n") if line.strip()])
            except ValueError as error:
                raise TraceError(f"{path}: unreadable time: {error}") from error
        path = self.folder / "times.txt"
        return _read_numbers(path, 1)[:, 0] if path.is_file() else None

    def _timestamp(self, number: int) -> float:
        if self._timestamps is None:
            return number * 0.1  # KITTI's cameras run at 10 Hz
        if number >= len(self._timestamps):
            raise TraceError(
                f"{self.folder}: frame {number} has no time, the time file ends at {len(self._timestamps)}"
            )
        return float(self._timestamps[number])

    def _gnss(self, number: int) -> GnssFix | None:
        if number >= len(self._oxts):
            return None
        path = self._oxts[number]
        row = _read_numbers(path, 30)[0]
        return GnssFix(
            lon_deg=float(row[_OXTS_LON]),
            lat_deg=float(row[_OXTS_LAT]),
            altitude_m=float(row[_OXTS_ALT]),
            horizontal_sigma_m=max(float(row[_OXTS_POS_ACCURACY]), 0.1),
            heading_rad=float(np.pi / 2 - row[_OXTS_YAW]),
        )

    def _read_poses(self) -> GroundTruth | None:
        path = self.folder / "poses.txt"
        if not path.is_file():
            return None
        rows = _read_numbers(path, 12)
        numbers = self.frame_numbers
        if numbers[-1] >= len(rows):
            raise TraceError(f"{path}: {len(rows)} poses, but the drive has a frame {numbers[-1]}")
        poses = np.tile(np.eye(4), (len(numbers), 1, 1))
        poses[:, :3] = rows[numbers].reshape(-1, 3, 4)
        return GroundTruth(poses @ self._T_reference_left)


def _read_numbers(path: Path, columns: int) -> NDArray[np.float64]:
    """Rows of at least `columns` finite numbers."""
    try:
        rows = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise TraceError(f"{path}: expected rows of {columns} numbers: {error}") from error
    if rows.shape[1] < columns or not np.isfinite(rows).all():
        raise TraceError(f"{path}: expected rows of {columns} finite numbers, found {rows.shape[1]} columns")
    return rows


def _parse_kitti_time(text: str) -> float:
    date, _, fraction = text.strip().partition(".")
    return datetime.fromisoformat(date).replace(tzinfo=UTC).timestamp() + float(f"0.{fraction or 0}")


def _read_calibration(path: Path, raw: bool) -> dict[int, NDArray[np.float64]]:
    """Projection matrices (3, 4) of the rectified cameras by number."""
    prefix = "P_rect_0" if raw else "P"
    projections: dict[int, NDArray[np.float64]] = {}
    try:
        for line in path.read_text().splitlines():
            key, _, values = line.partition(":")
            if key.startswith(prefix) and key[len(prefix) :].isdecimal():
                projections[int(key[len(prefix) :])] = np.array(values.split(), dtype=np.float64).reshape(3, 4)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise TraceError(f"{path}: unreadable calibration: {error}") from error
    return projections


def _stereo_camera(
    path: Path, projections: dict[int, NDArray[np.float64]], pair: tuple[int, int], size: tuple[int, int]
) -> tuple[StereoCamera, NDArray[np.float64]]:
    """Camera of a pair, and the pose of its left camera in the rectified reference camera."""
    for number in pair:
        if number not in projections:
            raise TraceError(f"{path}: no projection matrix of camera {number}")
        if abs(np.linalg.det(projections[number][:, :3])) < 1e-9 or not np.isfinite(projections[number]).all():
            raise TraceError(f"{path}: the projection matrix of camera {number} is singular")
    left, right = (projections[camera] for camera in pair)
    K = left[:, :3]
    centres = [-np.linalg.solve(p[:, :3], p[:, 3]) for p in (left, right)]
    baseline = float(centres[1][0] - centres[0][0])
    if baseline <= 0:
        raise TraceError(f"{path}: camera {pair[1]} is not to the right of camera {pair[0]}")
    camera = StereoCamera(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), baseline, *size)
    return camera, make_pose(np.eye(3), centres[0])
