"""How long each step of the pipelines takes, measured in one place."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

import numpy as np

KEPT = 4096


class _Stage:
    """One `with` block; a generator would take three times as long, and a diff has eight of them."""

    __slots__ = ("_count", "_name", "_start", "_times")

    def __init__(self, times: StageTimes, name: str, count: int) -> None:
        self._times, self._name, self._count = times, name, count

    def __enter__(self) -> None:
        self._start = self._times.clock()

    def __exit__(self, *raised: object) -> None:
        times = self._times
        took_ms = 1000 * (times.clock() - self._start) / self._count
        values = times.milliseconds.get(self._name)
        if values is None:
            values = times.milliseconds[self._name] = deque(maxlen=KEPT)
        values.extend((took_ms,) * self._count)


class StageTimes:
    """Milliseconds per stage, the newest `KEPT` of each."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.clock = clock
        self.milliseconds: dict[str, deque[float]] = {}

    def stage(self, name: str, count: int = 1) -> _Stage:
        """Time a `with` block under this name; of one that does so many things at once, each took its part."""
        return _Stage(self, name, count)

    def median_ms(self) -> dict[str, float]:
        """Median of each stage, milliseconds, in the order in which the stages first ran."""
        return {name: float(np.median(values)) for name, values in self.milliseconds.items()}

    def p95_ms(self) -> dict[str, float]:
        """95th percentile of each stage, milliseconds."""
        return {name: float(np.percentile(values, 95)) for name, values in self.milliseconds.items()}
