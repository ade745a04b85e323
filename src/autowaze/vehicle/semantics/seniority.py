"""Which of two tracks on the parts of one vehicle goes on with it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_YOUNG, _OLD = 3, 5  # frames: the parts of a vehicle are seldom taken for two vehicles for longer, mistakes seldom last
_MIN_FIT = 0.5
_MIN_GAIN = 0.2


def prefer_elders(
    rows: NDArray[np.int64],
    hits: NDArray[np.int64],
    area: NDArray[np.floating],
    fit: NDArray[np.float64],
    possible: NDArray[np.bool_],
) -> None:
    """Give elder tracks the vehicles that young ones have taken from them.

    What divides a vehicle in the image, a pedestrian who walks before it or a network in doubt, begins a second track
    on one of its parts. When the whole is seen again, or the other part dwindles, the young track lies nearer in the
    image. The elder one goes on with what fills its place better and is larger than what it was given, and the young
    one with that.

    Args:
        rows: (D,) track of each detection, -1 for none; changed.
        hits: (T,) in how many frames each track was seen; tracks in the order in which they began.
        area: (D,) of the detections, in any unit.
        fit: (D, T) overlap of the detections with where each track should be seen, 0 to 1.
        possible: (D, T) whether kind and depth allow it.
    """
    given = np.full(len(hits), -1)
    known = np.flatnonzero(rows >= 0)
    given[rows[known]] = known
    for d in known[hits[rows[known]] <= _YOUNG]:
        young = rows[d]
        now = np.where(given >= 0, fit[given, np.arange(len(hits))], 0.0)
        lesser = (given < 0) | (area[given] < area[d])
        elder = (np.arange(len(hits)) < young) & (hits >= _OLD)
        gain = np.where(possible[d] & elder & lesser & (fit[d] >= _MIN_FIT), fit[d] - now, 0.0)
        best = int(gain.argmax())
        if gain[best] >= _MIN_GAIN:
            rows[d] = best
            if given[best] >= 0:
                rows[given[best]] = young
            given[best], given[young] = d, given[best]
