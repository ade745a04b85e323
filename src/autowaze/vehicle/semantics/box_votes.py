"""The layout of the bundled model: every second pixel votes for the box of its instance.

The input is [1, 1, H, W] float32, grey in -1..1, H and W multiples of 32. The output [1, 2 + C + 4, H/2, W/2] holds
for every second input pixel the logits of background and of C classes; the distances from the pixel's centre to the
left, top, right and bottom side of the box round the visible part of its instance, as logarithms of multiples of
`DISTANCE_UNIT` input pixels; and the logit of the overlap that this box has with the true one. Instances are pixels
whose boxes agree: voting for one's own instance after the Hough forests (Gall and Lempitsky 2009), the box and the
estimate of its quality as in FCOS (Tian et al. 2019), though here every pixel speaks and its mask comes with it.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.classes import UNKNOWN_CLASS, labels_of_classes
from autowaze.vehicle.semantics.letterbox import Letterbox, paste_in_box
from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.network import Network
from autowaze.vehicle.semantics.vote_grouping import instances_of_votes
from autowaze.world.errors import ModelError
from autowaze.world.frame import Image, to_grey
from autowaze.world.instances import Detections

CLASSES = ("vehicle", "two-wheeler", "person", "cone")
"""What the bundled model tells apart; a cone may be any barrier of road works."""
DISTANCE_UNIT = 8.0
OUTPUT_STRIDE = 2

_MIN_CONFIDENCE = 0.35
_LONG_SIDE = 832
_CERTAIN = 4.0


class BoxVotes:
    """A model of the bundled layout."""

    def __init__(self, network: Network, config: ModelConfig) -> None:
        self._network = network
        self._input, shape = next(iter(network.inputs.items()))
        self._fixed_size = (shape[2], shape[3]) if shape[2] and shape[3] else None
        self._long_side = config.long_side or _LONG_SIDE
        self._min_confidence = config.min_confidence if config.min_confidence is not None else _MIN_CONFIDENCE
        names = config.class_names or dict(enumerate(CLASSES))
        self._label_of_class = labels_of_classes(names)
        channels = next(iter(network.outputs.values()))[1]
        if channels != len(self._label_of_class) + 6:
            raise ModelError(
                f"{network.path}: {channels} channels do not fit {len(self._label_of_class)} classes; state the "
                f"classes in {network.path.stem}.json"
            )

    @staticmethod
    def recognises(network: Network) -> bool:
        """Whether input and output have this layout."""
        inputs, outputs = list(network.inputs.values()), list(network.outputs.values())
        return (
            len(inputs) == len(outputs) == 1
            and len(inputs[0]) == len(outputs[0]) == 4
            and inputs[0][1] == 1
            and (outputs[0][1] or 0) > 6
        )

    @property
    def name(self) -> str:
        """File name without suffix."""
        return self._network.path.stem

    def segment(self, image: Image) -> Detections:
        """Confident instances, boxes and masks at image size, most confident first."""
        size = (image.shape[0], image.shape[1])
        letterbox = self._letterbox(size)
        blob = cv2.dnn.blobFromImage(letterbox.apply(to_grey(image)), 1 / 127.5, mean=127.5)
        votes = self._network.run({self._input: blob})[0][0]
        owner, margin, confidence, number = group_votes(np.ascontiguousarray(votes, np.float32))
        label = self._label_of_class[number]
        kept = np.flatnonzero((confidence >= self._min_confidence) & (label != UNKNOWN_CLASS))
        kept = kept[np.argsort(-confidence[kept], kind="stable")]
        masks, boxes = _masks(kept, owner, margin, letterbox, size)
        seen = np.flatnonzero(masks.any(axis=(1, 2)))
        return Detections(boxes, label[kept], confidence[kept], masks)[seen]

    def _letterbox(self, size: tuple[int, int]) -> Letterbox:
        if self._fixed_size is None:
            return Letterbox.free(size, self._long_side)
        return Letterbox.fixed(size, width=self._fixed_size[1], height=self._fixed_size[0])


def group_votes(
    votes: NDArray[np.float32],
) -> tuple[NDArray[np.int16], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Instances from the output (2 + C + 4, h, w) of the network.

    Returns:
        owner: (h, w) int16, number of the instance that a pixel belongs to, -1 for none.
        margin: (h, w) float32, logit of the best class above that of the background.
        confidence: (K,) float32 in 0..1.
        class_number: (K,) int64.
    """
    margin, ys, xs, kinds = _foreground(votes[:-5])
    distance = DISTANCE_UNIT * np.exp(np.clip(votes[-5:-1, ys, xs], -6.0, 6.0)).T
    at = (OUTPUT_STRIDE * np.stack([xs, ys], axis=1) + OUTPUT_STRIDE / 2).astype(np.float32)
    boxes = np.concatenate([at - distance[:, :2], at + distance[:, 2:]], axis=1).astype(np.float32)
    owner = np.full(margin.shape, -1, np.int16)
    cell_owner, confidence, number = instances_of_votes(
        at, boxes, kinds, _sigmoid(margin[ys, xs]), _sigmoid(votes[-1, ys, xs]), OUTPUT_STRIDE
    )
    owner[ys, xs] = cell_owner
    return owner, margin, confidence, number


@numba.njit(cache=True)
def _foreground(
    logits: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Where (1 + C, h, w) logits show more than background: margins (h, w); rows, columns and classes (N,)."""
    classes, height, width = logits.shape
    margin = np.empty((height, width), np.float32)
    kind = np.empty((height, width), np.int64)
    count = 0
    for y in range(height):
        for x in range(width):
            best = 1
            for k in range(2, classes):
                if logits[k, y, x] > logits[best, y, x]:
                    best = k
            margin[y, x] = logits[best, y, x] - logits[0, y, x]
            kind[y, x] = best - 1
            count += margin[y, x] > 0
    ys, xs, kinds = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    n = 0
    for y in range(height):
        for x in range(width):
            if margin[y, x] > 0:
                ys[n], xs[n], kinds[n] = y, x, kind[y, x]
                n += 1
    return margin, ys, xs, kinds


def _sigmoid(x: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)), np.float32)


def _masks(
    kept: NDArray[np.int64],
    owner: NDArray[np.int16],
    margin: NDArray[np.float32],
    letterbox: Letterbox,
    size: tuple[int, int],
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Masks (N, H, W) and boxes (N, 4): a pixel is in the mask where its logit is positive, interpolated."""
    masks = np.zeros((len(kept), *size), np.bool_)
    boxes = np.zeros((len(kept), 4), np.float32)
    per_pixel = letterbox.scale / OUTPUT_STRIDE
    padding = (letterbox.left / OUTPUT_STRIDE, letterbox.top / OUTPUT_STRIDE)
    extents = _extents(owner, int(kept.max(initial=-1)) + 1)
    for mask, box, number in zip(masks, boxes, kept, strict=True):
        x0, y0, x1, y1 = extents[number]
        x0, y0 = max(int(x0) - 2, 0), max(int(y0) - 2, 0)
        window = np.s_[y0 : int(y1) + 3, x0 : int(x1) + 3]
        logits = np.clip(margin[window], -_CERTAIN, _CERTAIN)
        # what stands next to it has a margin of its own, which says that the pixel is not of this instance
        logits = np.where(owner[window] == number, logits, -np.abs(logits))
        offset = (padding[0] - x0, padding[1] - y0)
        corners = np.array([x0, y0, x0 + logits.shape[1], y0 + logits.shape[0]], np.float32)
        around = (corners - np.array([*padding, *padding], np.float32)) / np.float32(per_pixel)
        paste_in_box(mask, around, logits, (per_pixel, per_pixel), offset, threshold=0.0)
        columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
        if len(rows):
            box[:] = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
    return masks, boxes


@numba.njit(cache=True)
def _extents(owner: NDArray[np.int16], count: int) -> NDArray[np.int64]:
    """First and last column and row (count, 4), x0, y0, x1, y1, of every instance's pixels."""
    extents = np.empty((count, 4), np.int64)
    extents[:, :2], extents[:, 2:] = max(owner.shape), -1
    for y in range(owner.shape[0]):
        for x in range(owner.shape[1]):
            k = owner[y, x]
            if 0 <= k < count:
                extents[k, 0], extents[k, 1] = min(extents[k, 0], x), min(extents[k, 1], y)
                extents[k, 2], extents[k, 3] = max(extents[k, 2], x), max(extents[k, 3], y)
    return extents
