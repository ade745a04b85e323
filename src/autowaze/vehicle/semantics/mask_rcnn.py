"""The Mask R-CNN export layouts (He et al. 2017): torchvision's, and that of detectron2's tracing export.

Both give boxes [N, 4] in input pixels, integer classes [N], scores [N] and masks, in an order that differs between
versions, so outputs are told apart by rank and type.

torchvision: input [3, H, W] or [1, 3, H, W], RGB in 0..1, which the network resizes and normalises itself; classes are
COCO category ids; masks [N, 1, H, W] are probabilities over the whole input.

detectron2 (tools/deploy/export_model.py, tracing): input [3, H, W], BGR in 0..255, resized by the caller; classes are
the 80 of COCO counted from 0; masks [N, 1, 28, 28] are probabilities over each box; the image size comes as a fifth.

ONNX model zoo (from maskrcnn-benchmark): as detectron2's, but BGR less its mean, sides in whole strides of at most
1280 x 960, to which its boxes are clipped, and classes counted from 1. Nothing in the file tells it from detectron2's.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.candidates import Candidates, label_of
from autowaze.vehicle.semantics.classes import COCO, COCO_BY_CATEGORY_ID, labels_of_classes
from autowaze.vehicle.semantics.letterbox import Letterbox, paste_in_box
from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.network import Network
from autowaze.world.errors import ModelError
from autowaze.world.frame import Image
from autowaze.world.instances import Detections

_MIN_CONFIDENCE = 0.5
_ROI_MASK_PX = 64  # masks over a box are 28 or 14 pixels wide; anything larger lies over the image
_ZOO_WIDTH, _ZOO_HEIGHT = 1280, 960
_ZOO_MEAN_BGR = np.array([102.9801, 115.9465, 122.7717], np.float32)
_SHORT_SIDE, _LONG_SIDE = 800, 1333  # detectron2's INPUT.MIN_SIZE_TEST and MAX_SIZE_TEST


class TorchvisionMaskRcnn:
    """A torchvision Mask R-CNN export."""

    _classes = COCO_BY_CATEGORY_ID

    def __init__(self, network: Network, config: ModelConfig) -> None:
        self._network = network
        self._config = config
        self._input, self._shape = next(iter(network.inputs.items()))
        self._label_of_class = labels_of_classes(config.class_names or dict(enumerate(self._classes)))
        self._min_confidence = config.min_confidence if config.min_confidence is not None else _MIN_CONFIDENCE

    @classmethod
    def recognises(cls, network: Network) -> bool:
        """Whether the outputs have this layout."""
        return _looks_like_mask_rcnn(network) and not _has_roi_masks(network)

    @property
    def name(self) -> str:
        """File name without suffix."""
        return self._network.path.stem

    def segment(self, image: Image) -> Detections:
        """Confident instances, boxes and masks at image size, most confident first."""
        size = (image.shape[0], image.shape[1])
        letterbox = self._letterbox(size)
        tensor = self._tensor(letterbox.apply(image))
        outputs = self._network.run({self._input: tensor[None] if len(self._shape) == 4 else tensor})
        boxes, classes, scores, masks = self._sort_out(outputs)
        label = label_of(self._label_of_class, classes)
        proposals = Candidates(boxes, label, scores, np.arange(len(boxes))).confident(self._min_confidence).best()
        found = Detections(
            letterbox.boxes_to_image(proposals.box, size),
            proposals.label,
            proposals.confidence,
            np.zeros((len(proposals), *size), np.bool_),
        )
        for mask, box, row in zip(found.mask, found.box, proposals.row, strict=True):
            _paste(mask, box, masks[row], letterbox)
        return found

    def _letterbox(self, size: tuple[int, int]) -> Letterbox:
        height, width = self._shape[-2:]
        if height and width:
            return Letterbox.fixed(size, width=width, height=height)
        return Letterbox.scaled(size, self._scale(size))

    def _scale(self, size: tuple[int, int]) -> float:
        return min(1.0, self._config.long_side / max(size)) if self._config.long_side else 1.0

    def _tensor(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        return _planes(image, swap=True) / np.float32(255)

    def _sort_out(self, outputs: list[NDArray[Any]]) -> tuple[NDArray[Any], ...]:
        """Boxes, classes, scores and masks (N, h, w) among the outputs."""
        boxes = next((o for o in outputs if o.ndim == 2 and o.shape[1] == 4), None)
        masks = next((o for o in outputs if o.ndim in (3, 4) and o.dtype.kind == "f"), None)
        n = -1 if boxes is None else len(boxes)
        scores = next((o for o in outputs if o.ndim == 1 and o.dtype.kind == "f" and len(o) == n), None)
        classes = next((o for o in outputs if o.ndim == 1 and o.dtype.kind in "iu" and len(o) == n), None)
        if boxes is None or masks is None or scores is None or classes is None or len(masks) != n:
            found = ", ".join(f"{o.dtype} {list(o.shape)}" for o in outputs)
            raise ModelError(f"{self._network.path}: expected boxes, classes, scores and masks, found {found}")
        masks = masks.reshape(n, *masks.shape[-2:])
        return boxes.astype(np.float32), classes, scores.astype(np.float32), masks.astype(np.float32)


class Detectron2MaskRcnn(TorchvisionMaskRcnn):
    """A Mask R-CNN from detectron2's tracing export."""

    _classes = COCO

    @classmethod
    def recognises(cls, network: Network) -> bool:
        """Whether the outputs have this layout."""
        return _looks_like_mask_rcnn(network) and _has_roi_masks(network)

    def _scale(self, size: tuple[int, int]) -> float:
        return min(_SHORT_SIDE / min(size), (self._config.long_side or _LONG_SIDE) / max(size))

    def _tensor(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        return _planes(image, swap=False)


class OnnxZooMaskRcnn(TorchvisionMaskRcnn):
    """The Mask R-CNN of the ONNX model zoo; its layout must be stated."""

    _classes = ("background", *COCO)

    @classmethod
    def recognises(cls, network: Network) -> bool:
        """Never: the outputs are those of detectron2's export."""
        return False

    def _letterbox(self, size: tuple[int, int]) -> Letterbox:
        return Letterbox.strided(size, min(_SHORT_SIDE / min(size), _ZOO_HEIGHT / size[0], _ZOO_WIDTH / size[1]))

    def _tensor(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        return _planes(image, swap=False) - _ZOO_MEAN_BGR[:, None, None]


def _looks_like_mask_rcnn(network: Network) -> bool:
    """Boxes of rank 2, masks of rank 3 or 4, and classes and scores of rank 1."""
    ranks = sorted(len(shape) for shape in network.outputs.values())
    return len(network.inputs) == 1 and ranks.count(1) >= 2 and 2 in ranks and ranks[-1] in (3, 4)


def _has_roi_masks(network: Network) -> bool:
    """Whether the masks have a small fixed size."""
    shape = max(network.outputs.values(), key=len)
    return all(side is not None and side <= _ROI_MASK_PX for side in shape[-2:])


def _planes(image: NDArray[np.uint8], *, swap: bool) -> NDArray[np.float32]:
    """(3, H, W) float32 of a grey or BGR image, as RGB if `swap`."""
    colour = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)) if image.ndim == 2 else image
    planes = np.moveaxis(colour, 2, 0)
    return np.ascontiguousarray(planes[::-1] if swap else planes, dtype=np.float32)


def _paste(
    mask: NDArray[np.bool_], box: NDArray[np.float32], values: NDArray[np.float32], letterbox: Letterbox
) -> None:
    """Fill the box with a mask that lies over the box, or over the network's input."""
    height, width = values.shape
    if max(height, width) <= _ROI_MASK_PX:
        x_scale, y_scale = width / (box[2] - box[0]), height / (box[3] - box[1])
        offset = (float(-box[0] * x_scale), float(-box[1] * y_scale))
        paste_in_box(mask, box, values, (float(x_scale), float(y_scale)), offset, threshold=0.5)
        return
    x_ratio, y_ratio = width / letterbox.width, height / letterbox.height
    offset = (letterbox.left * x_ratio, letterbox.top * y_ratio)
    per_pixel = (letterbox.scale * x_ratio, letterbox.scale * y_ratio)
    paste_in_box(mask, box, values, per_pixel, offset, threshold=0.5)
