"""The YOLO-seg export layout: boxes with class scores and mask coefficients, and mask prototypes.

Prototype masks after YOLACT (Bolya et al. 2019). One output [1, 4 + classes + K, anchors] holds box centre and size in
input pixels, class probabilities and K mask coefficients; the other [1, K, H/4, W/4] the prototypes. The input is
[1, 3, H, W], RGB in 0..1.
"""

from __future__ import annotations

import ast
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.candidates import Candidates
from autowaze.vehicle.semantics.classes import COCO, UNKNOWN_CLASS, labels_of_classes
from autowaze.vehicle.semantics.letterbox import Letterbox, paste_in_box
from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.network import Network
from autowaze.world.errors import ModelError
from autowaze.world.frame import Image
from autowaze.world.instances import Detections

_MIN_CONFIDENCE = 0.4
_LONG_SIDE = 1248  # KITTI's width in whole strides: at this size each car of a dense row gets its own mask


class YoloSeg:
    """A YOLO-seg export."""

    def __init__(self, network: Network, config: ModelConfig) -> None:
        self._network = network
        self._input, shape = next(iter(network.inputs.items()))
        self._fixed_size = (shape[2], shape[3]) if shape[2] and shape[3] else None
        shapes = list(network.outputs.values())
        self._detection_output = next(i for i, s in enumerate(shapes) if len(s) == 3)
        self._prototype_output = next(i for i, s in enumerate(shapes) if len(s) == 4)
        self._long_side = config.long_side or _LONG_SIDE
        self._min_confidence = config.min_confidence if config.min_confidence is not None else _MIN_CONFIDENCE
        self._label_of_class = labels_of_classes(config.class_names or self._names_in_metadata())
        self._wanted = np.flatnonzero(self._label_of_class != UNKNOWN_CLASS)

    @staticmethod
    def recognises(network: Network) -> bool:
        """Whether the outputs have this layout."""
        ranks = sorted(len(shape) for shape in network.outputs.values())
        return len(network.inputs) == 1 and ranks == [3, 4]

    @property
    def name(self) -> str:
        """File name without suffix."""
        return self._network.path.stem

    def segment(self, image: Image) -> Detections:
        """Confident instances, boxes and masks at image size, most confident first."""
        size = (image.shape[0], image.shape[1])
        letterbox = self._letterbox(size)
        outputs = self._network.run({self._input: _blob(letterbox.apply(image))})
        prototypes = np.asarray(outputs[self._prototype_output][0], np.float32)
        rows = outputs[self._detection_output][0]
        found = self._decode(rows, len(prototypes)).best()
        boxes = letterbox.boxes_to_image(found.box, size)
        coefficients = np.ascontiguousarray(rows[-len(prototypes) :, found.row].T, np.float32)
        masks = _masks(boxes, coefficients, prototypes, letterbox, size)
        return Detections(boxes, found.label, found.confidence, masks)

    def _letterbox(self, size: tuple[int, int]) -> Letterbox:
        if self._fixed_size is None:
            return Letterbox.free(size, self._long_side)
        return Letterbox.fixed(size, width=self._fixed_size[1], height=self._fixed_size[0])

    def _decode(self, rows: NDArray[Any], n_coefficients: int) -> Candidates:
        """The confident anchors; boxes in input pixels, rows are anchors."""
        n_classes = len(rows) - 4 - n_coefficients
        if n_classes < 1 or self._wanted.max(initial=-1) >= n_classes:
            raise ModelError(
                f"{self._network.path}: {len(rows)} rows per anchor do not fit {n_coefficients} prototypes and "
                f"{len(self._label_of_class)} classes; state the classes in {self._network.path.stem}.json"
            )
        scores = rows[4 + self._wanted]
        best = scores.argmax(axis=0)
        confidence = np.take_along_axis(scores, best[None], axis=0)[0]
        anchors = np.flatnonzero(confidence >= self._min_confidence)
        centre, half = rows[:2, anchors].T, rows[2:4, anchors].T / 2
        return Candidates(
            np.concatenate([centre - half, centre + half], axis=1).astype(np.float32),
            self._label_of_class[self._wanted[best[anchors]]],
            confidence[anchors].astype(np.float32),
            anchors,
        ).confident(self._min_confidence)

    def _names_in_metadata(self) -> dict[int, str]:
        text = self._network.metadata.get("names")
        if text is None:
            return dict(enumerate(COCO))
        try:
            return {int(number): str(name) for number, name in ast.literal_eval(text).items()}
        except (ValueError, SyntaxError, AttributeError) as error:
            raise ModelError(f"{self._network.path}: unreadable class names in its metadata: {text[:60]!r}") from error


def _blob(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(1, 3, H, W) float32 RGB in 0..1."""
    if image.ndim == 2:
        return np.repeat((image.astype(np.float32) / np.float32(255))[None, None], 3, axis=1)
    return np.ascontiguousarray(cv2.dnn.blobFromImage(image, 1.0 / 255.0, swapRB=True), np.float32)


def _masks(
    boxes: NDArray[np.float32],
    coefficients: NDArray[np.float32],
    prototypes: NDArray[np.float32],
    letterbox: Letterbox,
    size: tuple[int, int],
) -> NDArray[np.bool_]:
    """Masks (N, H, W): the prototypes weighted by the coefficients are logits, cut to the box."""
    masks = np.zeros((len(boxes), *size), np.bool_)
    ratio = prototypes.shape[2] / letterbox.width
    per_pixel = letterbox.scale * ratio
    padding = np.array([letterbox.left, letterbox.top]) * ratio
    for mask, box, weights in zip(masks, boxes, coefficients, strict=True):
        # Only the prototypes under the box, with a margin for the interpolation.
        x0, y0 = np.maximum((box[:2] * per_pixel + padding).astype(int) - 1, 0)
        x1, y1 = (box[2:] * per_pixel + padding).astype(int) + 3
        logits = np.tensordot(weights, prototypes[:, y0:y1, x0:x1], axes=1)
        offset = (float(padding[0] - x0), float(padding[1] - y0))
        paste_in_box(mask, box, logits, (per_pixel, per_pixel), offset, threshold=0.0)
    return masks
