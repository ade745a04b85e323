"""How long each step of the cloud took."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

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
