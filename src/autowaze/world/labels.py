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

_IS_VEHICLE, _IS_MOVABLE = np.isin(np.arange(256), VEHICLES), np.isin(np.arange(256), MOVABLE)


def is_vehicle(labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mask of the vehicle labels."""
    return _in_table(_IS_VEHICLE, labels)


def is_movable(labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mask of the labels of things that come and go."""
    return _in_table(_IS_MOVABLE, labels)


def _in_table(table: NDArray[np.bool_], labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mask of the labels that a table marks."""
    if labels.dtype == np.uint8:  # as frames and maps have them: a look-up is ten times as fast
        mask: NDArray[np.bool_] = table[labels]
        return mask
    return np.isin(labels, np.flatnonzero(table))
