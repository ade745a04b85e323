"""Who was refused what, in the audit log: the first of a kind at once, the rest as a number, so that no disk fills."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import OrderedDict
from collections.abc import Callable

from autowaze.cloud.store import AuditEntry, StoreError

EVERY_S = 60.0
"""One actor's refusals of one kind make one entry in this time."""
MOST_IN_TIME = 60
"""Entries of all actors in that time."""
MOST_KINDS = 4096
MOST_DETAIL = 300

_log = logging.getLogger(__name__)


class RefusalLog:
    """Writes to an audit log, never more than so many entries a minute.

    Args:
        audit: keeps an entry; called in a thread of its own.
        clock: seconds since the epoch (UTC).
    """

    def __init__(self, audit: Callable[[AuditEntry], None], clock: Callable[[], float] = time.time) -> None:
        self._audit = audit
        self._clock = clock
        self._seen: OrderedDict[tuple[str, str], tuple[float, int]] = OrderedDict()
        self._begun, self._written = 0.0, 0
        self._writing: set[asyncio.Future[None]] = set()

    def note(self, actor: str, action: str, detail: str) -> None:
        """Note one refusal, or one access that matters, in the event loop.

        Args:
            actor: name of the token; empty for nobody known.
            action: of what kind.
            detail: one line for a person.
        """
        now = self._clock()
        last, left_out = self._seen.pop((actor, action), (-EVERY_S, 0))
        if now - self._begun >= EVERY_S:
            self._begun, self._written = now, 0
        due = now - last >= EVERY_S and self._written < MOST_IN_TIME
        self._seen[actor, action] = (now, 0) if due else (last, left_out + 1)
        if len(self._seen) > MOST_KINDS:
            self._seen.popitem(last=False)
        if not due:
            return
        self._written += 1
        more = f"; {left_out} more like it before" if left_out else ""
        line = "".join(c if c.isprintable() else "?" for c in detail[:MOST_DETAIL])
        entry = AuditEntry(0, now, actor, action, line + more)
        writing = asyncio.get_running_loop().run_in_executor(None, self._write, entry)
        self._writing.add(writing)
        writing.add_done_callback(self._writing.discard)

    async def written(self) -> None:
        """Wait until all that was noted is kept."""
        await asyncio.gather(*self._writing)

    def _write(self, entry: AuditEntry) -> None:
        try:
            self._audit(entry)
        except StoreError as error:
            _log.error("not in the audit log: %s %s: %s (%s)", entry.actor, entry.action, entry.detail, error)
