"""ORB features of one image: oriented corners with steered binary descriptors (Rublee et al. 2011)."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.vision.compiled import compiled
from autowaze.vehicle.vision.corners import CornerFinder, Corners
from autowaze.vehicle.vision.pyramid import Pyramid, PyramidLayout
from autowaze.world.columns import Columns
from autowaze.world.features import DESCRIPTOR_BYTES
from autowaze.world.frame import Image

_MOMENT_RADIUS_PX = 15  # of the intensity centroid
_PATTERN_RADIUS_PX = 13
_N_STEERINGS = 64  # orientations for which the pattern is prepared; ORB uses 30
_BLUR = (7, 7), 2.0


@dataclass
class Keypoints(Columns):
    """Corners of one image, N rows.

    Attributes:
        uv: (N, 2) float32 pixels of the full image.
        octave: (N,) uint8. angle: (N,) float32, radians.
        descriptor: (N, 32) uint8.
    """

    uv: NDArray[np.float32]
    octave: NDArray[np.uint8]
    angle: NDArray[np.float32]
    descriptor: NDArray[np.uint8]


class OrbDetector:
    """Finds the features of one camera's images, one image at a time; `pyramid` holds the last one."""

    def __init__(self, n_features: int, layout: PyramidLayout, fast_threshold: int) -> None:
        self.pyramid = Pyramid(layout)
        self._blurred = Pyramid(layout)
        quota = level_quota(n_features, layout)
        self._shares = fair_shares(layout)
        self._finders = [CornerFinder(self.pyramid, share, quota, fast_threshold) for share in self._shares]
        self._taps = _taps(layout)

    def detect(self, image: Image, helper: Executor) -> Corners:
        """Corners of a grey image of the layout's size; the helper takes half of the work."""
        self.pyramid.fill(image)
        others = helper.submit(self._detect, 1)
        return Corners.concatenate([self._detect(0), others.result()])

    def _detect(self, share: int) -> Corners:
        for level in self._shares[share]:
            cv2.GaussianBlur(self.pyramid.levels[level], *_BLUR, dst=self._blurred.levels[level])
        return self._finders[share].find()

    def describe(self, corners: Corners) -> Keypoints:
        """Orientation and descriptor of corners that `detect` found in the last image."""
        layout = self.pyramid.layout
        where = layout.width, layout.offset, corners.xy, corners.octave
        angle = _orientation(self.pyramid.block, *where, _CIRCLE)
        descriptor = _descriptors(self._blurred.block, *where, angle, self._taps)
        uv = layout.to_image(corners.peak, corners.octave).astype(np.float32)
        return Keypoints(uv, corners.octave, angle, descriptor)


def fair_shares(layout: PyramidLayout) -> list[list[int]]:
    """The levels in two lists of about as many pixels."""
    shares: list[list[int]] = [[], []]
    pixels = [0, 0]
    for level, size in enumerate(layout.width * layout.height):
        less = int(pixels[1] < pixels[0])
        shares[less].append(level)
        pixels[less] += int(size)
    return shares


def level_quota(n_features: int, layout: PyramidLayout) -> NDArray[np.int64]:
    """Features per pyramid level (L,), in geometric proportion, that sum to `n_features`."""
    share = 1.0 / layout.scale
    quota = np.rint(n_features * share / share.sum()).astype(np.int64)
    quota[-1] += n_features - quota.sum()
    return np.asarray(quota)


def sampling_pattern() -> NDArray[np.float64]:
    """Ends of the 256 binary tests (256, 2, 2), x and y in pixels: normally distributed (BRIEF, Calonder et al. 2010).

    Descriptors of stored maps depend on it, so it comes from integers alone and never changes: a linear congruential
    generator (Knuth's MMIX), sums of whose draws are nearly normal with a deviation of a fifth of the patch.
    """
    state = 2024
    points: list[tuple[float, float]] = []
    while len(points) < 16 * DESCRIPTOR_BYTES:
        draws = []
        for _ in range(8):
            state = (state * 6364136223846793005 + 1442695040888963407) & (2**64 - 1)
            draws.append((state >> 33) % 31 - 15)
        x, y = sum(draws[:4]) / 2.9, sum(draws[4:]) / 2.9  # deviation 31 / 5
        if x * x + y * y <= _PATTERN_RADIUS_PX**2:
            points.append((x, y))
    return np.array(points).reshape(-1, 2, 2)


def _steered_pattern() -> NDArray[np.int8]:
    """The pattern turned to each orientation, (steerings, 512, 2), whole pixels."""
    turn = 2 * np.pi * np.arange(_N_STEERINGS) / _N_STEERINGS
    c, s = np.cos(turn), np.sin(turn)
    R = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    return np.asarray(np.rint(sampling_pattern().reshape(-1, 2) @ R.transpose(0, 2, 1)), dtype=np.int8)


def _taps(layout: PyramidLayout) -> NDArray[np.uint32]:
    """The steered pattern as steps in the memory of each level from the patch's first pixel, (L, steerings, 512)."""
    dx, dy = (_STEERED[None, :, :, i].astype(np.int64) + _PATTERN_RADIUS_PX for i in (0, 1))
    return np.ascontiguousarray(dy * layout.width[:, None, None] + dx, dtype=np.uint32)


def _circle() -> NDArray[np.int64]:
    """Half width of each row of the moment's disc, (2 r + 1,)."""
    rows = np.arange(-_MOMENT_RADIUS_PX, _MOMENT_RADIUS_PX + 1)
    return np.asarray(np.floor(np.sqrt(_MOMENT_RADIUS_PX**2 - rows**2 + 0.5)), dtype=np.int64)


_STEERED = _steered_pattern()
_CIRCLE = _circle()


@compiled
def _orientation(block, width, offset, xy, octave, circle):  # type: ignore[no-untyped-def]
    """Orientations (N,) float32 of corners at level pixels (N, 2), towards the centroid of intensity.

    Integers are narrowed by hand where the compiler would widen them: twice as many fit into a vector register.
    """
    n, radius = xy.shape[0], circle.shape[0] // 2
    angle = np.empty(n, np.float32)
    for i in range(n):
        w = width[octave[i]]
        centre = offset[octave[i]] + xy[i, 1] * w + xy[i, 0]
        moment_x, moment_y = np.int32(0), np.int32(0)
        for dy in range(-radius, radius + 1):
            half = circle[dy + radius]
            row = block[centre + dy * w - half : centre + dy * w + half + 1]
            total, weighted = np.int32(0), np.int32(0)
            for k in range(row.shape[0]):
                value = np.int32(row[k])
                total = np.int32(total + value)
                weighted = np.int32(weighted + np.int32(k) * value)
            moment_x = np.int32(moment_x + weighted - np.int32(half) * total)
            moment_y = np.int32(moment_y + np.int32(dy) * total)
        angle[i] = np.arctan2(np.float64(moment_y), np.float64(moment_x))
    return angle


@compiled
def _descriptors(blurred, width, offset, xy, octave, angle, taps):  # type: ignore[no-untyped-def]
    """Descriptors (N, 32) of corners at level pixels (N, 2).

    Apart from the orientations: in one loop with them the compiler keeps neither in vector registers. Unsigned indices
    need no test for the end, the sign of the difference no branch that would be foretold wrongly half of the time.
    """
    n, n_steerings = xy.shape[0], taps.shape[1]
    descriptor = np.empty((n, DESCRIPTOR_BYTES), np.uint8)
    one = np.uint64(1)
    for i in range(n):
        level = octave[i]
        corner_y, corner_x = xy[i, 1] - _PATTERN_RADIUS_PX, xy[i, 0] - _PATTERN_RADIUS_PX
        first = np.uint64(offset[level] + corner_y * width[level] + corner_x)
        steering = np.int64(np.rint(angle[i] * n_steerings / (2 * np.pi))) % n_steerings
        tap = taps[level, steering]
        for byte in range(DESCRIPTOR_BYTES):
            bits = np.uint32(0)
            for bit in range(8):
                k = np.uint64(16 * byte + 2 * bit)
                a = np.int32(blurred[first + np.uint64(tap[k])])
                b = np.int32(blurred[first + np.uint64(tap[k + one])])
                bits |= np.uint32(np.uint32(np.int32(a - b)) >> np.uint32(31)) << np.uint32(bit)
            descriptor[i, byte] = bits
    return descriptor
