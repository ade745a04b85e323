"""From the class names that segmentation models are trained with to our labels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from autowaze.world.labels import ClassLabel

UNKNOWN_CLASS = 255
"""Label of a model's class that means nothing to Autowaze."""

_LABELS = {
    ClassLabel.CAR: ("car", "van", "vehicle"),
    ClassLabel.TRUCK: ("truck",),
    ClassLabel.BUS: ("bus",),
    ClassLabel.TWO_WHEELER: ("bicycle", "motorcycle", "motorbike", "two-wheeler", "two_wheeler", "cyclist"),
    ClassLabel.PERSON: ("person", "pedestrian", "rider"),
    ClassLabel.CONE: ("cone", "traffic cone", "barrier"),
    ClassLabel.TRAFFIC_LIGHT: ("traffic light",),
    ClassLabel.STOP_SIGN: ("stop sign",),
    ClassLabel.ANIMAL: ("cat", "dog", "horse", "sheep", "cow"),
}
_LABEL_OF_NAME = {name: label for label, names in _LABELS.items() for name in names}

# The 91 category ids of COCO (Lin et al. 2014, cocodataset.org); ids that its releases leave out are empty.
_COCO_CATEGORIES = (
    "|person|bicycle|car|motorcycle|airplane|bus|train|truck|boat|traffic light|fire hydrant||stop sign|parking meter|"
    "bench|bird|cat|dog|horse|sheep|cow|elephant|bear|zebra|giraffe||backpack|umbrella|||handbag|tie|suitcase|frisbee|"
    "skis|snowboard|sports ball|kite|baseball bat|baseball glove|skateboard|surfboard|tennis racket|bottle||wine glass|"
    "cup|fork|knife|spoon|bowl|banana|apple|sandwich|orange|broccoli|carrot|hot dog|pizza|donut|cake|chair|couch|"
    "potted plant|bed||dining table|||toilet||tv|laptop|mouse|remote|keyboard|cell phone|microwave|oven|toaster|sink|"
    "refrigerator||book|clock|vase|scissors|teddy bear|hair drier|toothbrush"
)
COCO_BY_CATEGORY_ID = tuple(_COCO_CATEGORIES.split("|"))
"""Names at their COCO category ids."""
COCO = tuple(name for name in COCO_BY_CATEGORY_ID if name)
"""The 80 COCO classes, numbered without gaps."""


def labels_of_classes(names: Mapping[int, str]) -> NDArray[np.uint8]:
    """Table (highest class number + 1,) uint8 from a model's class number to a `ClassLabel`, else `UNKNOWN_CLASS`."""
    table = np.full(max(names, default=-1) + 1, UNKNOWN_CLASS, np.uint8)
    for number, name in names.items():
        table[number] = _LABEL_OF_NAME.get(name.strip().lower(), UNKNOWN_CLASS)
    return table


def kinds(labels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Labels (N,) with all vehicles as CAR: a van is car in one frame and truck in the next."""
    return np.where(np.isin(labels, (ClassLabel.TRUCK, ClassLabel.BUS)), np.uint8(ClassLabel.CAR), labels)
