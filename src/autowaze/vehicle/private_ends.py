"""Keeps to the car where its drives begin and end: at somebody's home, mostly."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.wire import decode_diff


class PrivateEnds:
    """Passes on the diffs of a drive less those of its first and last metres.

    A diff goes on once the car has driven so far beyond it; what is still held back when the drive ends is never sent.
    The numbers of the windows that go on do not tell how many were kept back at the end.

    Args:
        length_m: of either end, along the path.
        send: takes the bytes of diffs.
    """

    def __init__(self, length_m: float, send: Callable[[bytes], object]) -> None:
        self._length_m = length_m
        self._send = send
        self._driven_m = 0.0
        self._last: tuple[float, float] | None = None
        self._held: deque[tuple[float, bytes]] = deque()

    def send(self, message: bytes) -> None:
        """Take the bytes of the drive's next diff, and send those that are private no longer."""
        begun_m = self._driven_m
        self._driven_m += self._way_m(decode_diff(message))
        if begun_m >= self._length_m:
            self._held.append((self._driven_m, message))
        while self._held and self._driven_m - self._held[0][0] >= self._length_m:
            self._send(self._held.popleft()[1])

    def _way_m(self, diff: SemanticMapDiff) -> float:
        path = diff.trajectory.position[:, :2]
        if len(path) == 0:
            return 0.0
        if self._last is not None:
            path = np.vstack([self._last, path])
        self._last = (float(path[-1, 0]), float(path[-1, 1]))
        return float(np.hypot(*np.diff(path, axis=0).T).sum())
