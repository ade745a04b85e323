"""A cloud service that forgets nothing that it has acknowledged."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from autowaze.cloud.broadcast import Update
from autowaze.cloud.service import CloudService
from autowaze.cloud.spot_edits import SpotEdit, check_edit
from autowaze.cloud.store import Accepted, Store, StoreError
from autowaze.world.errors import WireError
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import SpotState
from autowaze.world.wire import decode_diff


class DurableService:
    """Takes diffs into a `CloudService` and a `Store` together.

    A diff is acknowledged by returning its update, and that happens only after the diff and the states that it
    changed were committed in one transaction. A new process replays the log: the same diffs give the same state.

    Args:
        open_service: makes the service with nothing integrated yet; called again when the state must be rebuilt.
        store: the log and the spots.
        clock: seconds since the epoch, for the time of receipt.
        admit: refuses diffs, with `RefusedDiffError`, for what does not follow from the log, such as the time of day.
        observe: is shown every update with the time of receipt, once it is durable, and again when the log is replayed.
    """

    def __init__(
        self,
        open_service: Callable[[], CloudService],
        store: Store,
        clock: Callable[[], float] = time.time,
        admit: Callable[[SemanticMapDiff], None] | None = None,
        observe: Callable[[Update, float], None] | None = None,
    ) -> None:
        self._open_service = open_service
        self.store = store
        self._clock = clock
        self._admit = admit
        self._observe = observe
        self._lock = threading.Lock()
        self.service = self._recovered()

    def receive(self, payload: bytes) -> Update:
        """Take in the bytes of one diff; what it returns is durable.

        Raises:
            WireError: no diff, or one that says something impossible; nothing has changed.
            StoreError: it could not be kept; nothing has changed, the car may send it again.
        """
        update = self.receive_many([payload])[0]
        if isinstance(update, WireError):
            raise update
        return update

    def receive_many(self, payloads: Sequence[bytes]) -> list[Update | WireError]:
        """Take in several diffs with one commit; a bad one yields its error and does not touch the others.

        Raises:
            StoreError: none of them could be kept; nothing has changed.
        """
        with self._lock:
            try:
                return self._take_in(payloads)
            except BaseException:
                self.service = self._recovered()
                raise

    def edit(self, edit: SpotEdit, actor: str) -> tuple[int, SpotState | None]:
        """Draw or erase a spot; durable, like diffs, when it returns the version of the parking map and the state.

        Raises:
            RefusedEditError: the spot cannot be so; nothing has changed.
            StoreError: it could not be kept; nothing has changed.
        """
        with self._lock:
            check_edit(edit, self.service.spots)
            edit = replace(edit, position=self.store.position)
            try:
                state = self.service.edit(edit)
                version = self.store.commit_edit(edit.encoded(), actor, edit.spot_id, state)
            except BaseException:
                self.service = self._recovered()
                raise
            return version, state

    def _take_in(self, payloads: Sequence[bytes]) -> list[Update | WireError]:
        results: list[Update | WireError] = []
        accepted, updates, changed = [], [], {}
        for payload in payloads:
            try:
                with self.service.times.stage("decode"):
                    diff = decode_diff(payload)
                if self._admit is not None and not self.service.map.knows(diff):
                    self._admit(diff)
                update = self.service.integrate(diff, len(payload))
            except WireError as error:
                results.append(error)
                continue
            results.append(update)
            if update.accepted:
                accepted.append(Accepted(diff.session, diff.sequence, self._clock(), bytes(payload)))
                updates.append(update)
                changed.update({state.spot_id: state for state in update.spots})
        if accepted:
            self.store.commit(accepted, changed.values())
        if self._observe is not None:
            for kept, update in zip(accepted, updates, strict=True):
                self._observe(update, kept.received_at)
        return results

    def _recovered(self) -> CloudService:
        """The state after every diff of the log; the stored spots follow it where method or parking map changed."""
        service = self._open_service()
        edits = deque(SpotEdit.decoded(data) for data in self.store.spot_edits())
        _make_up_to(0, edits, service)
        for position, accepted in enumerate(self.store.log(), start=1):
            try:
                update = service.receive(accepted.payload)
            except WireError as error:
                raise StoreError(
                    f"diff {position} of the store cannot be taken in again: {error}; start the service with the "
                    "parking map and base map that the store was made with"
                ) from error
            if self._observe is not None:
                self._observe(update, accepted.received_at)
            _make_up_to(position, edits, service)
        known = {state.spot_id: state for state in service.states if state.observed_at is not None}
        if known != {state.spot_id: state for state in self.store.spots()}:
            self.store.replace_spots(known.values())
        return service


def _make_up_to(position: int, edits: deque[SpotEdit], service: CloudService) -> None:
    """Make the edits that were made before the diff after this position."""
    while edits and edits[0].position <= position:
        service.edit(edits.popleft())
