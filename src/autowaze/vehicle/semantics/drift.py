"""How far odometry has drifted since things left the view: a histogram filter (Thrun et al. 2005, sec. 4.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_REACH_M, _CELL_M = 3.0, 0.25
_PRIOR_SIGMA_M = 0.8  # of a car's odometry over a car park
_WALK = 0.02  # share of a cell that goes to each of its neighbours in a frame
_RETURN = 0.02  # share that forgets in a frame what was learned: what leaves the view later has drifted less


class DriftHistogram:
    """Probability (O,) of each of the offsets (O, 2) in metres over ground."""

    def __init__(self) -> None:
        axis = np.arange(-_REACH_M, _REACH_M + _CELL_M / 2, _CELL_M)
        self._cells = len(axis)
        self.offsets = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        prior = np.exp(-(self.offsets**2).sum(axis=1) / (2 * _PRIOR_SIGMA_M**2))
        self._prior = prior / prior.sum()
        self.probability = self._prior

    @property
    def mean(self) -> NDArray[np.float64]:
        """Expected offset (2,)."""
        return np.asarray(self.probability @ self.offsets)

    @property
    def sigma(self) -> float:
        """Standard deviation along the axis where it is larger."""
        return float(np.sqrt((self.probability @ (self.offsets - self.mean) ** 2).max()))

    def walk(self) -> None:
        """One frame on."""
        p = self.probability.reshape(self._cells, self._cells)
        for axis in (0, 1):
            p = p + _WALK * (np.roll(p, 1, axis) + np.roll(p, -1, axis) - 2 * p)
        self.probability = (1 - _RETURN) * p.reshape(-1) + _RETURN * self._prior

    def update(self, log_likelihood: NDArray[np.float64]) -> None:
        """Take in evidence (O,)."""
        p = self.probability * np.exp(log_likelihood - log_likelihood.max())
        self.probability = p / p.sum()
