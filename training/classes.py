"""Which class of the network a label of the simulator is."""

from __future__ import annotations

import numpy as np

from autowaze.vehicle.semantics.cell_links import CLASSES
from autowaze.world.labels import ClassLabel

_CLASS_NAMES = {
    ClassLabel.CAR: "vehicle",
    ClassLabel.TRUCK: "vehicle",
    ClassLabel.BUS: "vehicle",
    ClassLabel.TWO_WHEELER: "two-wheeler",
    ClassLabel.PERSON: "person",
    ClassLabel.CONE: "cone",
}
CLASS_OF_LABEL = np.zeros(256, np.uint8)
"""Class of the network by `ClassLabel`: 0 background, else 1 plus the place in `CLASSES`."""
for _label, _name in _CLASS_NAMES.items():
    CLASS_OF_LABEL[_label] = 1 + CLASSES.index(_name)
