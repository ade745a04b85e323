"""A cloud service that forgets nothing that it has acknowledged."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from autowaze.cloud.admission import Admission
from autowaze.cloud.broadcast import Update
from autowaze.cloud.service import CloudService
from autowaze.cloud.spot_edits import SpotEdit, check_edit
from autowaze.cloud.store import Accepted, Store, StoreError
from autowaze.cloud.validation import RefusedDiffError
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
        admit: refuses diffs for what does not follow from the log, such as the time of day or whose they are.
        observe: is shown every update with the time of receipt, once it is durable, and again when the log is replayed.
    """

    def __init__(
        self,
        open_service: Callable[[], CloudService],
        store: Store,
        clock: Callable[[], float] = time.time,
        admit: Admission | None = None,
        observe: Callable[[Update, float], None] | None = None,
    ) -> None:
        self._open_service = open_service
        self.store = store
        self._clock = clock
        self._admission = admit
        self._observe = observe
        self._lock = threading.Lock()
        self.service = self._recovered()

    def receive(self, payload: bytes, sender: str | None = None) -> Update:
        """Take in the bytes of one diff; what it returns is durable.

        Args:
            payload: as it came over the wire.
            sender: name of the token that it was handed in with; None where nobody needs one.

        Raises:
            WireError: no diff, or one that says something impossible; nothing has changed.
            StoreError: it could not be kept; nothing has changed, the car may send it again.
        """
        update = self.receive_many([payload], [sender])[0]
        if isinstance(update, WireError):
            raise update
        return update

    def receive_many(
        self, payloads: Sequence[bytes], senders: Sequence[str | None] | None = None
    ) -> list[Update | WireError]:
        """Take in several diffs with one commit; a bad one yields its error and does not touch the others.

        Raises:
            StoreError: none of them could be kept; nothing has changed.
        """
        with self._lock:
            try:
                return self._take_in(payloads, senders or [None] * len(payloads))
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

    def _take_in(self, payloads: Sequence[bytes], senders: Sequence[str | None]) -> list[Update | WireError]:
        results: list[Update | WireError] = []
        accepted: list[Accepted] = []
        updates, changed = [], {}
        for payload, sender in zip(payloads, senders, strict=True):
            try:
                with self.service.times.stage("decode"):
                    diff = decode_diff(payload)
                with self.service.times.stage("admission"):
                    self._admit(diff, payload, sender, accepted)
                    source = self._admission.source_of(diff, sender) if self._admission else None
                update = self.service.integrate(diff, len(payload), source)
            except WireError as error:
                results.append(error)
                continue
            results.append(update)
            if update.accepted:
                received_at = self._clock()
                if self._admission is not None:
                    self._admission.note(diff, received_at, sender)
                accepted.append(Accepted(diff.session, diff.sequence, received_at, bytes(payload)))
                updates.append(update)
                changed.update({state.spot_id: state for state in update.spots})
        if accepted:
            self.store.commit(accepted, changed.values())
        if self._observe is not None:
            for kept, update in zip(accepted, updates, strict=True):
                self._observe(update, kept.received_at)
        return results

    def _admit(self, diff: SemanticMapDiff, payload: bytes, sender: str | None, waiting: list[Accepted]) -> None:
        """Refuse what the admission refuses, and other content under the key of a diff that was taken in before.

        Args:
            waiting: accepted diffs that are not in the store yet.
        """
        if not self.service.map.knows(diff):
            if self._admission is not None:
                self._admission.admit(diff, sender, self.service)
            return
        if self._admission is not None:
            self._admission.admit_again(diff, sender)
        held = next((a.payload for a in waiting if (a.session, a.sequence) == diff.key), None)
        held = self.store.payload(*diff.key) if held is None else held
        if held is not None and held != payload:
            name = f"diff {diff.session}/{diff.sequence} refused"
            raise RefusedDiffError(f"{name}: another diff has this number; draw a new session", "replayed")

    def _recovered(self) -> CloudService:
        """The state after every diff of the log; the stored spots follow it where method or parking map changed."""
        service = self._open_service()
        if self._admission is not None:
            self._admission.forget()
        edits = deque(SpotEdit.decoded(data) for data in self.store.spot_edits())
        _make_up_to(0, edits, service)
        for position, accepted in enumerate(self.store.log(), start=1):
            try:
                diff = decode_diff(accepted.payload)
                source = self._admission.source_of(diff) if self._admission else None
                update = service.integrate(diff, len(accepted.payload), source)
            except WireError as error:
                raise StoreError(
                    f"diff {position} of the store cannot be taken in again: {error}; start the service with the "
                    "parking map and base map that the store was made with"
                ) from error
            if self._admission is not None:
                self._admission.note(diff, accepted.received_at)
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
