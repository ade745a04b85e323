"""Class labels that Autowaze tells apart, as stored in maps and diffs."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class ClassLabel(IntEnum):
    """What a feature belongs to. The numbers are part of the wire format: never renumber."""

    BACKGROUND = 0
    CAR = 1
    TRUCK = 2
    BUS = 3
    TWO_WHEELER = 4
    PERSON = 5
    CONE = 6
    TRAFFIC_LIGHT = 7
    STOP_SIGN = 8
    ANIMAL = 9


VEHICLES = (ClassLabel.CAR, ClassLabel.TRUCK, ClassLabel.BUS)
"""Labels that can occupy a parking spot."""

MOVABLE = (*VEHICLES, ClassLabel.TWO_WHEELER, ClassLabel.PERSON, ClassLabel.CONE, ClassLabel.ANIMAL)
"""Labels of things that may be elsewhere tomorrow."""

_IS_VEHICLE = np.isin(np.arange(256), VEHICLES)


def is_vehicle(labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mask of the vehicle labels."""
    if labels.dtype == np.uint8:  # as maps have them: a table is ten times as fast
        mask: NDArray[np.bool_] = _IS_VEHICLE[labels]
        return mask
    return np.isin(labels, VEHICLES)


def is_movable(labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mask of the labels of things that come and go."""
    return np.isin(labels, MOVABLE)
