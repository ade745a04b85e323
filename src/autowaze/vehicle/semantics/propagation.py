"""Carrying masks over the frames that are not segmented, by sparse optical flow inside each mask."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.world.frame import Image
from autowaze.world.instances import Detections

_POINTS_PER_INSTANCE = 30
_MIN_POINTS = 4
_WINDOW_PX, _LEVELS = 15, 3  # follows about 60 px of motion
_MAX_RETURN_PX = 1.0  # a point tracked there and back again must come home
_MIN_FOLLOWED = 0.15  # of an instance's points
_MAX_DISAGREEMENT_PX = 10.0  # the near end of a car moves faster than the far end
_CONFIDENCE_KEPT = 0.97  # per frame without a look


def propagate(detections: Detections, before: Image, after: Image) -> Detections:
    """The detections of the grey image `before` where they are in `after` (pyramidal Lucas-Kanade, Bouguet 2000).

    Each mask moves by the median shift and scale of its points; an instance whose points cannot be followed, or that
    leaves the image, is dropped.
    """
    points, owner = _points_inside(detections, before)
    if not len(points):
        return detections[:0]
    moved, followed = _follow(points, before, after)
    out = Detections(
        detections.box.copy(), detections.label, detections.confidence * np.float32(_CONFIDENCE_KEPT), detections.mask
    )
    out.mask = np.zeros_like(detections.mask)
    kept = np.zeros(len(detections), np.bool_)
    for i in range(len(detections)):
        mine = owner == i
        similarity = _scale_and_shift(points[mine & followed], moved[mine & followed], int(np.count_nonzero(mine)))
        if similarity is not None:
            kept[i] = _move(detections.mask[i], detections.box[i], similarity, out.mask[i], out.box[i])
    return out[kept]


def _points_inside(detections: Detections, image: Image) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Corners (P, 2) inside the masks and the row of the mask that each belongs to."""
    points, owner = [np.zeros((0, 2), np.float32)], [np.zeros(0, np.int64)]
    for i, (box, mask) in enumerate(zip(detections.box, detections.mask, strict=True)):
        x0, y0 = np.floor(box[:2]).astype(int)
        x1, y1 = np.ceil(box[2:]).astype(int)
        part = np.ascontiguousarray(mask[y0:y1, x0:x1]).view(np.uint8)
        if part.size:
            corners = cv2.goodFeaturesToTrack(image[y0:y1, x0:x1], _POINTS_PER_INSTANCE, 0.01, 3, mask=part)
            if corners is not None:
                points.append(np.asarray(corners, np.float32).reshape(-1, 2) + np.array([x0, y0], np.float32))
                owner.append(np.full(len(corners), i))
    return np.concatenate(points), np.concatenate(owner)


def _follow(points: NDArray[np.float32], before: Image, after: Image) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where points (P, 2) went, and which of them can be trusted."""
    window = (_WINDOW_PX, _WINDOW_PX)
    moved, there, _ = cv2.calcOpticalFlowPyrLK(before, after, points, points.copy(), winSize=window, maxLevel=_LEVELS)
    home, back, _ = cv2.calcOpticalFlowPyrLK(after, before, moved, points.copy(), winSize=window, maxLevel=_LEVELS)
    returned = np.linalg.norm(home - points, axis=1) < _MAX_RETURN_PX
    return np.asarray(moved, np.float32), returned & (there.ravel() > 0) & (back.ravel() > 0)


def _scale_and_shift(
    before: NDArray[np.float32], after: NDArray[np.float32], n_points: int
) -> tuple[float, float, float] | None:
    """Scale s and shift (x, y) with after = s before + shift, from medians; None unless most points agree."""
    if len(before) < max(_MIN_POINTS, _MIN_FOLLOWED * n_points):
        return None
    centre_before, centre_after = np.median(before, axis=0), np.median(after, axis=0)
    spread_before = np.abs(before - centre_before).sum(axis=1)
    spread_after = np.abs(after - centre_after).sum(axis=1)
    far = spread_before > np.median(spread_before) * 0.5
    scale = float(np.clip(np.median(spread_after[far] / np.maximum(spread_before[far], 1e-3)), 0.8, 1.25))
    shift = centre_after - scale * centre_before
    error = np.linalg.norm(scale * before + shift - after, axis=1)
    if np.median(error) > _MAX_DISAGREEMENT_PX:
        return None
    return scale, float(shift[0]), float(shift[1])


def _move(
    mask: NDArray[np.bool_],
    box: NDArray[np.float32],
    similarity: tuple[float, float, float],
    moved_mask: NDArray[np.bool_],
    moved_box: NDArray[np.float32],
) -> bool:
    """Write the moved mask and box; whether anything of it is still in the image."""
    scale, dx, dy = similarity
    height, width = mask.shape
    corners = scale * box.reshape(2, 2) + np.array([dx, dy], np.float32)
    moved_box[:] = np.clip(corners, 0, np.array([width, height], np.float32)).ravel()
    x0, y0 = np.floor(moved_box[:2]).astype(int)
    x1, y1 = np.ceil(moved_box[2:]).astype(int)
    if x1 - x0 < 2 or y1 - y0 < 2:
        return False
    sx0, sy0 = np.maximum(np.floor(box[:2]).astype(int) - 1, 0)
    sx1, sy1 = np.ceil(box[2:]).astype(int) + 1
    source = np.ascontiguousarray(mask[sy0:sy1, sx0:sx1]).view(np.uint8)
    to_source = np.array([[1 / scale, 0.0, (x0 - dx) / scale - sx0], [0.0, 1 / scale, (y0 - dy) / scale - sy0]])
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    moved_mask[y0:y1, x0:x1] = cv2.warpAffine(source, to_source, (x1 - x0, y1 - y0), flags=flags) > 0
    return bool(moved_mask[y0:y1, x0:x1].any())
