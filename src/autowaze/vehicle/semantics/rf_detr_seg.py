"""The RF-DETR-Seg export layout (Robinson et al. 2025; github.com/roboflow/rf-detr, Apache-2.0).

Input [1, 3, S, S], RGB with ImageNet's mean and deviation, the image stretched to the square. Outputs: boxes
[1, Q, 4] as centre and size in shares of the image, class logits [1, Q, C] numbered by COCO category id, and mask
logits [1, Q, h, w] over the whole image.
"""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.candidates import Candidates, label_of
from autowaze.vehicle.semantics.classes import COCO_BY_CATEGORY_ID, UNKNOWN_CLASS, labels_of_classes
from autowaze.vehicle.semantics.letterbox import paste_in_box
from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.network import Network
from autowaze.world.errors import ModelError
from autowaze.world.frame import Image
from autowaze.world.instances import Detections

_MIN_CONFIDENCE = 0.4
_SIDE = 432  # of the published segmentation checkpoint, where the export leaves it free
_MEAN = np.array([0.485, 0.456, 0.406], np.float32)  # ImageNet, RGB
_DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)


class RfDetrSeg:
    """An RF-DETR-Seg export."""

    def __init__(self, network: Network, config: ModelConfig) -> None:
        self._network = network
        self._input, shape = next(iter(network.inputs.items()))
        free = config.long_side or _SIDE
        self._size = (shape[3] or free, shape[2] or free)
        names = config.class_names or self._names_in_metadata() or dict(enumerate(COCO_BY_CATEGORY_ID))
        self._label_of_class = labels_of_classes(names)
        self._min_confidence = config.min_confidence if config.min_confidence is not None else _MIN_CONFIDENCE

    @staticmethod
    def recognises(network: Network) -> bool:
        """Whether the outputs have this layout."""
        shapes = list(network.outputs.values())
        ranks = sorted(len(shape) for shape in shapes)
        return len(network.inputs) == 1 and ranks == [3, 3, 4] and any(s[-1] == 4 for s in shapes if len(s) == 3)

    @property
    def name(self) -> str:
        """File name without suffix."""
        return self._network.path.stem

    def segment(self, image: Image) -> Detections:
        """Confident instances, boxes and masks at image size, most confident first."""
        height, width = image.shape[:2]
        shares, logits, masks = self._sort_out(self._network.run({self._input: self._tensor(image)}))
        centre, half = shares[:, :2], shares[:, 2:] / 2
        boxes = np.clip(np.concatenate([centre - half, centre + half], axis=1), 0, 1)
        boxes = (boxes * np.array([width, height, width, height])).astype(np.float32)
        labels, confidence = self._classify(logits)
        found = Candidates(boxes, labels, confidence, np.arange(len(boxes))).confident(self._min_confidence).best()
        out = Detections(found.box, found.label, found.confidence, np.zeros((len(found), height, width), np.bool_))
        for mask, box, row in zip(out.mask, out.box, found.row, strict=True):
            per_pixel = (masks.shape[2] / width, masks.shape[1] / height)
            paste_in_box(mask, box, masks[row], per_pixel, (0.0, 0.0), threshold=0.0)
        return out

    def _names_in_metadata(self) -> dict[int, str]:
        """Class names as recent exports carry them."""
        try:
            stated = json.loads(self._network.metadata.get("rfdetr_inference", "{}"))
            return {int(number): str(name) for number, name in stated.get("class_id_to_name", {}).items()}
        except (ValueError, AttributeError) as error:
            raise ModelError(f"{self._network.path}: unreadable class names in its metadata") from error

    def _tensor(self, image: Image) -> NDArray[np.float32]:
        colour = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
        square = np.asarray(cv2.resize(colour, self._size, interpolation=cv2.INTER_LINEAR), np.float32)
        normal = (square / np.float32(255) - _MEAN) / _DEVIATION
        return np.ascontiguousarray(np.moveaxis(normal, 2, 0)[None])

    def _classify(self, logits: NDArray[np.float32]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Label and confidence of the likeliest class (N,) that means something to Autowaze."""
        label = label_of(self._label_of_class, np.arange(logits.shape[1]))
        wanted = np.flatnonzero(label != UNKNOWN_CLASS)
        if not len(wanted):
            raise ModelError(
                f"{self._network.path}: none of its {logits.shape[1]} classes is known; "
                f"name them in {self._network.path.stem}.json"
            )
        best = logits[:, wanted].argmax(axis=1)
        score = logits[np.arange(len(logits)), wanted[best]]
        return label[wanted[best]], 1.0 / (1.0 + np.exp(-score, dtype=np.float32))

    def _sort_out(self, outputs: list[NDArray[Any]]) -> tuple[NDArray[np.float32], ...]:
        """Boxes (Q, 4), class logits (Q, C) and mask logits (Q, h, w)."""
        boxes = next(i for i, o in enumerate(outputs) if o.ndim == 3 and o.shape[2] == 4)
        logits = next(i for i, o in enumerate(outputs) if o.ndim == 3 and i != boxes)
        masks = next(i for i, o in enumerate(outputs) if o.ndim == 4)
        return tuple(np.asarray(outputs[i][0], np.float32) for i in (boxes, logits, masks))
