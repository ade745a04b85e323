"""What the car sees, drawn over its images: features, masks and ids."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing import FrameObservation
from autowaze.world.errors import AutowazeError
from autowaze.world.frame import StereoFrame

_FRAMES_PER_SECOND = 10.0
_MATCHED, _UNMATCHED = (80, 220, 80), (200, 160, 60)  # BGR


class OverlayVideo:
    """Overlays of a drive as an .mp4 file or a folder of JPEG pictures; use it in a `with` statement."""

    def __init__(self, target: Path) -> None:
        self.target = target
        self._writer: cv2.VideoWriter | None = None
        folder = target.parent if target.suffix else target
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise AutowazeError(f"{folder}: cannot be made: {error.strerror}") from error
        if target.suffix not in ("", ".mp4"):
            raise AutowazeError(f"{target}: give an .mp4 file or a folder for the overlays")

    @classmethod
    def open(cls, target: Path | None) -> OverlayVideo | NoOverlays:
        """Overlays into the target; none without one."""
        return cls(target) if target else NoOverlays()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        if self._writer is not None:
            self._writer.release()

    def add(self, frame: StereoFrame, observation: FrameObservation) -> None:
        """Draw one frame."""
        picture = draw_overlay(frame, observation)
        if not self.target.suffix:
            cv2.imwrite(str(self.target / f"{frame.index:06d}.jpg"), picture)
            return
        if self._writer is None:
            size = (picture.shape[1], picture.shape[0])
            codec = cv2.VideoWriter.fourcc(*"mp4v")
            self._writer = cv2.VideoWriter(str(self.target), codec, _FRAMES_PER_SECOND, size)
            if not self._writer.isOpened():
                raise AutowazeError(f"{self.target}: no video can be written there; give a folder instead")
        self._writer.write(picture)


class NoOverlays:
    """Takes the place of overlays that nobody asked for."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        return

    def add(self, frame: StereoFrame, observation: FrameObservation) -> None:
        """Draw nothing."""


def draw_overlay(frame: StereoFrame, observation: FrameObservation) -> NDArray[np.uint8]:
    """The left image (H, W, 3) with masks coloured by id, features by whether they matched, and the state."""
    grey = frame.left_grey
    picture = np.repeat(grey[:, :, None], 3, axis=2) if frame.left.ndim == 2 else frame.left.copy()
    tracks, tracked = observation.tracks, observation.tracked
    for i in range(len(tracks)):
        colour = colour_of_id(int(tracks.id[i]))
        mask = tracks.mask[i]
        picture[mask] = (0.6 * picture[mask] + 0.4 * np.array(colour)).astype(np.uint8)
    matched = tracked.landmark_id >= 0
    for selection, colour in ((~matched, _UNMATCHED), (matched, _MATCHED)):
        for u, v in np.rint(observation.features.uv[selection]).astype(int).tolist():
            cv2.circle(picture, (u, v), 2, colour, 1, cv2.LINE_AA)
    for i in range(len(tracks)):
        left, top = tracks.box[i, :2].astype(int).tolist()
        _write(picture, f"{int(tracks.id[i])}", (left, max(top - 4, 12)), colour_of_id(int(tracks.id[i])))
    text = f"frame {frame.index}  {tracked.state}  {tracked.n_inliers} inliers  {tracked.reason}"
    _write(picture, text, (8, 18), (255, 255, 255))
    return picture


def colour_of_id(instance_id: int) -> tuple[int, int, int]:
    """A BGR colour that stays with an id; neighbours in number differ in hue by the golden angle."""
    hsv = np.array([[[int(instance_id * 180 * 0.618) % 180, 190, 255]]], np.uint8)
    blue, green, red = cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)[0, 0].tolist()
    return blue, green, red


def _write(picture: NDArray[np.uint8], text: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
