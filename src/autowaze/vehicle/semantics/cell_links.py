"""The layout of the bundled model: every second pixel says what it shows and which cells around it are the same thing.

The input is [1, 1, H, W] float32, grey in -1..1, H and W multiples of 32. The output [1, 1 + C + L, H/2, W/2] holds for
every second input pixel, a cell, the logits of background and of C classes, and for each of `LINKS` the logit of this
cell and the one so far away being of one instance. Instances are what the links hold together (`mutex_watershed`,
`average_linkage`).
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.average_linkage import average_linkage
from autowaze.vehicle.semantics.classes import UNKNOWN_CLASS, labels_of_classes
from autowaze.vehicle.semantics.letterbox import Letterbox, paste_in_box
from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.mutex_watershed import mutex_watershed
from autowaze.vehicle.semantics.network import Network
from autowaze.world.errors import ModelError
from autowaze.world.frame import Image, to_grey
from autowaze.world.instances import Detections

CLASSES = ("vehicle", "two-wheeler", "person", "cone")
"""What the bundled model tells apart; a cone may be any barrier of road works."""
LINKS = ((1, 0), (0, 1), (3, 0), (0, 3), (8, 0), (0, 8), (5, 5), (-5, 5), (25, 0), (0, 20))
"""Columns and rows from a cell to those that it is linked with. The near ones see a seam, the far ones see across a
seam that is blurred, or a post that parts a car in two."""
OUTPUT_STRIDE = 2

_REACH = np.array(LINKS, np.int64)
_BIAS, _BIAS_OF_GROUPS = 0.8, 1.75
"""Logits, of single links and of those between two groups. Training counts pairs of cells that are apart more often
than they come: the network says it too soon. Groups may begin too small, they are joined; what is joined stays so."""
_MIN_CONFIDENCE = 0.71
_LONG_SIDE = 1152
_MID_GREY, _MOST_LIFT = 0.5, 0.5
"""Mean of a picture, as a share of the range, to which the shadows of a darker one are lifted, and the least exponent:
a street is exposed for its sky, and parked cars stand in the shade."""
_CERTAIN = 4.0
_MIN_CELLS, _MIN_CELLS_OF_VEHICLE = 8, 100
"""Less of a vehicle, 20 x 20 pixels of the input, is more often a rest of one; training asks little of it."""
_MAX_INSTANCES = 100


_TABLE_END, _STEPS_PER_LOGIT = 12, 64
_SIGMOID = 1 / (1 + np.exp(-np.linspace(-_TABLE_END, _TABLE_END, 2 * _TABLE_END * _STEPS_PER_LOGIT + 1)))


class CellLinks:
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
        if channels != len(self._label_of_class) + 1 + len(LINKS):
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
            and (outputs[0][1] or 0) > 1 + len(LINKS)
        )

    @property
    def name(self) -> str:
        """File name without suffix."""
        return self._network.path.stem

    def segment(self, image: Image) -> Detections:
        """Confident instances, boxes and masks at image size, most confident first."""
        size = (image.shape[0], image.shape[1])
        letterbox = self._letterbox(size)
        blob = cv2.dnn.blobFromImage(letterbox.apply(lifted(to_grey(image))), 1 / 127.5, mean=127.5)
        cells = self._network.run({self._input: blob})[0][0]
        owner, margin, confidence, number = group_cells(np.ascontiguousarray(cells, np.float32))
        label = self._label_of_class[number]
        kept = np.flatnonzero((confidence >= self._min_confidence) & (label != UNKNOWN_CLASS))
        kept = kept[np.argsort(-confidence[kept], kind="stable")]
        masks, boxes = _masks(kept, owner, margin, letterbox, size)
        found = Detections(boxes, label[kept], confidence[kept], masks)
        seen = boxes[:, 2] > 0
        return found if seen.all() else found[seen]  # masks are large

    def _letterbox(self, size: tuple[int, int]) -> Letterbox:
        if self._fixed_size is None:
            return Letterbox.free(size, self._long_side)
        return Letterbox.fixed(size, width=self._fixed_size[1], height=self._fixed_size[0])


def lifted(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture (H, W) uint8 with its shadows lifted by a power of its grey levels, if it is dark on the whole."""
    mean = max(float(cv2.mean(grey)[0]) / 255.0, 0.01)
    exponent = max(np.log(_MID_GREY) / np.log(mean), _MOST_LIFT) if mean < _MID_GREY else 1.0
    levels = 255.0 * np.linspace(0.0, 1.0, 256) ** exponent
    return np.asarray(cv2.LUT(grey, np.round(levels).astype(np.uint8)), np.uint8)


def group_cells(
    cells: NDArray[np.float32],
) -> tuple[NDArray[np.int16], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Instances from the output (1 + C + L, h, w) of the network.

    Returns:
        owner: (h, w) int16, number of the instance that a cell belongs to, -1 for none.
        margin: (h, w) float32, logit of the best class above that of the background.
        confidence: (K,) float32 in 0..1: how sure its cells are of their class, times the root of how sure the links
            that begin in it are of where it ends: a seam may be in doubt where a vehicle is not.
        class_number: (K,) int64.
    """
    margin, kind = _foreground(cells[: -len(LINKS)])
    links = cells[-len(LINKS) :]
    group, count = mutex_watershed(kind, links, _REACH, _BIAS)
    group = average_linkage(group, count, links, _REACH, _BIAS_OF_GROUPS)
    inside = np.flatnonzero(group >= 0)
    group_inside = group.ravel()[inside]
    area = np.bincount(group_inside, minlength=count)
    class_of_group = np.zeros(count, np.int8)
    class_of_group[group_inside] = kind.ravel()[inside]
    least = np.where(class_of_group == CLASSES.index("vehicle"), _MIN_CELLS_OF_VEHICLE, _MIN_CELLS)
    large = np.argsort(-area, kind="stable")[:_MAX_INSTANCES]
    large = large[area[large] >= least[large]]
    number = np.full(count + 1, -1, np.int16)
    number[large] = np.arange(len(large))
    owner = number[group]
    confidence, class_number = _judged(owner, kind, margin, links, len(large))
    return owner, margin, confidence, class_number


@numba.njit(cache=True, nogil=True)
def _foreground(logits: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.int8]]:
    """How much more (1 + C, h, w) logits show than background, and of which class, -1 where nothing: (h, w) each."""
    classes, height, width = logits.shape
    margin, kind = np.empty((height, width), np.float32), np.empty((height, width), np.int8)
    for y in range(height):
        for x in range(width):
            best = 1
            for k in range(2, classes):
                if logits[k, y, x] > logits[best, y, x]:
                    best = k
            margin[y, x] = logits[best, y, x] - logits[0, y, x]
            kind[y, x] = best - 1 if margin[y, x] > 0 else -1
    return margin, kind


@numba.njit(cache=True, nogil=True)
def _judged(
    owner: NDArray[np.int16],
    kind: NDArray[np.int8],
    margin: NDArray[np.float32],
    links: NDArray[np.float32],
    count: int,
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Confidence and class (count,) of the instances."""
    height, width = owner.shape
    shown, cells = np.zeros(count), np.zeros(count, np.int64)
    held, asked = np.zeros(count), np.zeros(count, np.int64)
    class_number = np.zeros(count, np.int64)
    for y in range(height):
        for x in range(width):
            k = owner[y, x]
            if k < 0:
                continue
            class_number[k] = kind[y, x]
            shown[k] += _sigmoid(margin[y, x])
            cells[k] += 1
            for link in range(len(links)):
                u, v = x + _REACH[link, 0], y + _REACH[link, 1]
                if 0 <= u < width and v < height and owner[v, u] >= 0:
                    same = _sigmoid(links[link, y, x])
                    held[k] += same if owner[v, u] == k else 1.0 - same
                    asked[k] += 1
    confidence = shown / np.maximum(cells, 1) * np.sqrt(held / np.maximum(asked, 1))
    return confidence.astype(np.float32), class_number


@numba.njit(cache=True, nogil=True)
def _sigmoid(x: float) -> float:
    """Of a logit, from a table: it is asked for a hundred thousand times a frame."""
    step = min(max(x, -_TABLE_END), _TABLE_END) * _STEPS_PER_LOGIT
    return float(_SIGMOID[int(step + _TABLE_END * _STEPS_PER_LOGIT + 0.5)])


def _masks(
    kept: NDArray[np.int64],
    owner: NDArray[np.int16],
    margin: NDArray[np.float32],
    letterbox: Letterbox,
    size: tuple[int, int],
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Masks (N, H, W) and boxes (N, 4), zero for nothing: a pixel is in where its logit is positive, interpolated."""
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
        left, top = np.maximum(around[:2].astype(int), 0)
        inside = mask[top : int(around[3]) + 1, left : int(around[2]) + 1]
        columns, rows = np.flatnonzero(inside.any(axis=0)), np.flatnonzero(inside.any(axis=1))
        if len(rows):
            box[:] = left + columns[0], top + rows[0], left + columns[-1] + 1, top + rows[-1] + 1
    return masks, boxes


@numba.njit(cache=True, nogil=True)
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
