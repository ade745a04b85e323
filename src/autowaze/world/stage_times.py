"""How long each step of the pipelines takes, measured in one place."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

KEPT = 4096


class StageTimes:
    """Milliseconds per stage, the newest `KEPT` of each."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self.milliseconds: dict[str, deque[float]] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block under this name."""
        start = self._clock()
        try:
            yield
        finally:
            self.milliseconds.setdefault(name, deque(maxlen=KEPT)).append(1000 * (self._clock() - start))

    def median_ms(self) -> dict[str, float]:
        """Median of each stage, milliseconds, in the order in which the stages first ran."""
        return {name: float(np.median(values)) for name, values in self.milliseconds.items()}

    def p95_ms(self) -> dict[str, float]:
        """95th percentile of each stage, milliseconds."""
        return {name: float(np.percentile(values, 95)) for name, values in self.milliseconds.items()}
