"""The log of a store, taken into a service once more."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from autowaze.cloud.broadcast import Update
from autowaze.cloud.service import CloudService
from autowaze.cloud.settlement import Settlement
from autowaze.cloud.spot_edits import SpotEdit
from autowaze.world.map_diff import SemanticMapDiff

_MOST_AT_ONCE = 64


class Replay:
    """Takes in diffs and makes the edits between them, in the order in which they were made.

    Args:
        service: with all diffs before.
        after: position in the log of the last of these.
        edits: what was made since, oldest first.
        observe: is shown every update with the time of receipt of its diff, if given.
    """

    def __init__(
        self,
        service: CloudService,
        after: int,
        edits: Sequence[SpotEdit],
        observe: Callable[[Update, float], None] | None = None,
    ) -> None:
        self._service = service
        self._position = after
        self._edits = deque(edits)
        self._observe = observe
        self._settlement = Settlement(service)
        self._received_at: deque[float] = deque()
        self._make_edits()

    def take(self, diff: SemanticMapDiff, size: int, source: int | None, received_at: float) -> None:
        """The next diff of the log; raises `WireError` as `CloudService.integrate`."""
        self._settlement.take(diff, size, source)
        self._received_at.append(received_at)
        self._position += 1
        if len(self._received_at) >= _MOST_AT_ONCE or (self._edits and self._edits[0].position <= self._position):
            self.settle()
            self._make_edits()

    def settle(self) -> None:
        """Settle what was taken."""
        for update in self._settlement.settle():
            received_at = self._received_at.popleft()
            if self._observe is not None:
                self._observe(update, received_at)

    def _make_edits(self) -> None:
        """Make the edits that were made before the next diff."""
        while self._edits and self._edits[0].position <= self._position:
            self._service.edit(self._edits.popleft())
