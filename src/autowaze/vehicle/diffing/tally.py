"""Counting observations by id over the frames of a window."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Tally:
    """Collects (id, value) pairs frame by frame; counts them when the window closes."""

    def __init__(self) -> None:
        self._ids: list[NDArray[np.int64]] = []
        self._values: list[NDArray[np.int64]] = []

    def add(self, ids: NDArray[np.integer], values: NDArray[np.integer] | int = 0) -> None:
        """Count each id (N,) once, with a value (N,) or one for all."""
        self._ids.append(np.asarray(ids, dtype=np.int64))
        self._values.append(np.broadcast_to(np.asarray(values, dtype=np.int64), len(ids)))

    def pairs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """All ids and values in the order they came."""
        if not self._ids:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        return np.concatenate(self._ids), np.concatenate(self._values)

    def counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sorted unique ids and how often each was counted."""
        ids, counts = np.unique(self.pairs()[0], return_counts=True)
        return ids, counts.astype(np.int64)

    def table(self, n_values: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sorted unique ids (N,) and how often each had each value, (N, n_values)."""
        ids, values = self.pairs()
        unique, row = np.unique(ids, return_inverse=True)
        cells = np.bincount(row * n_values + values, minlength=len(unique) * n_values)
        return unique, cells.reshape(len(unique), n_values).astype(np.int64)

    def majority(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sorted unique ids and the most frequent value of each (the smallest of equals)."""
        ids, values = self.pairs()
        if not len(ids):
            return ids, values
        order = np.lexsort((values, ids))
        ids, values = ids[order], values[order]
        new_run = np.flatnonzero(np.r_[True, (np.diff(ids) != 0) | (np.diff(values) != 0)])
        run_length = np.diff(np.r_[new_run, len(ids)])
        run_id, run_value = ids[new_run], values[new_run]
        best = np.lexsort((run_value, -run_length, run_id))
        first = np.r_[True, np.diff(run_id[best]) != 0]
        return run_id[best][first], run_value[best][first]
