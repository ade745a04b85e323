"""What a running service does for its store now and then: snapshots, and forgetting what was kept long enough."""

from __future__ import annotations

import gc
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from autowaze.cloud.durable import DurableService
from autowaze.cloud.snapshot import GivenUpError
from autowaze.world.errors import AutowazeError

DAY_S = 86_400.0
DIFFS_DAYS, HISTORY_DAYS = 7.0, 90.0
SNAPSHOT_DIFFS = 60_000
"""Diffs after which a new process would replay for too long, two and a half minutes."""
SNAPSHOT_S = 3600.0
"""A service with little to do is kept after this time, if anything changed."""
PAUSE_S = 30.0
SWEEP_S = 3600.0
"""A web server's own search for cycles among objects ends with the young ones; this often all are searched."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Retention:
    """How long things are kept; for ever where it says None.

    Attributes:
        diffs_days: the diffs themselves, which tell where cars drove: once a snapshot holds what follows from them they
            are needed no longer than an operator wants to look back at them, or work them out anew by another method.
        history_days: changes of spots, which name no car, and the audit log.
    """

    diffs_days: float | None = DIFFS_DAYS
    history_days: float | None = HISTORY_DAYS


class Upkeep:
    """Looks after a store in a thread of its own, from entering to leaving; leaving takes a last snapshot.

    Args:
        durable: the running service.
        retention: how long things are kept.
        clock: seconds since the epoch (UTC).
    """

    def __init__(
        self, durable: DurableService, retention: Retention | None = None, clock: Callable[[], float] = time.time
    ) -> None:
        self._durable = durable
        self._retention = retention or Retention()
        self._clock = clock
        self._kept_position = -1
        self._kept_at = self._swept_at = clock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._go_on, name="upkeep")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *raised: object) -> None:
        self._stop.set()
        self._thread.join()
        self._try(self._snapshot)

    def tidy(self) -> None:
        """Take a snapshot if one is due, delete what was kept long enough, let the store do what it needs."""
        new = self._durable.store.position - max(self._kept_position, 0)
        if new >= SNAPSHOT_DIFFS or (new > 0 and self._clock() - self._kept_at >= SNAPSHOT_S):
            self._snapshot(self._stop)
        if self._clock() - self._swept_at >= SWEEP_S:
            gc.collect()
            self._swept_at = self._clock()
        days = (self._retention.diffs_days, self._retention.history_days)
        diffs, history = (0.0 if d is None else self._clock() - d * DAY_S for d in days)
        pruned = self._durable.store.prune(diffs, history)
        self._durable.store.tidy()
        if pruned:
            _log.info("%d diffs older than %g days deleted", pruned, self._retention.diffs_days)

    def _snapshot(self, until: threading.Event | None = None) -> None:
        if self._durable.store.position != self._kept_position:
            self._kept_position = self._durable.snapshot(until)
            self._kept_at = self._clock()

    def _go_on(self) -> None:
        while not self._stop.wait(PAUSE_S):
            self._try(self.tidy)

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except GivenUpError as error:
            _log.info("%s, for the service stops", error)
        except AutowazeError as error:
            _log.error("the store could not be looked after: %s", error)
