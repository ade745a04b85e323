"""A cloud service that forgets nothing that it has acknowledged."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Protocol

from autowaze.cloud.admission import Admission
from autowaze.cloud.broadcast import Update
from autowaze.cloud.replay import Replay
from autowaze.cloud.service import CloudService
from autowaze.cloud.settlement import Settlement
from autowaze.cloud.snapshot import SnapshotError, packed_parts, unpack
from autowaze.cloud.spot_edits import SpotEdit, check_edit
from autowaze.cloud.store import Accepted, Store, StoreError
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.errors import WireError
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.parking import SpotState
from autowaze.world.wire import decode_diff

_log = logging.getLogger(__name__)


class Follower(Protocol):
    """Something that the updates build up, and that a snapshot holds."""

    def kept(self) -> dict[str, Any]:
        """What it holds."""

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""


class DurableService:
    """Takes diffs into a `CloudService` and a `Store` together.

    A diff is acknowledged by returning its update, and that happens only after the diff and the states that it
    changed were committed in one transaction. A new process takes the newest snapshot and replays the log from there:
    the same diffs give the same state.

    Args:
        open_service: makes the service with nothing integrated yet; called again when the state must be rebuilt.
        store: the log and the spots.
        clock: seconds since the epoch, for the time of receipt.
        admit: refuses diffs for what does not follow from the log, such as the time of day or whose they are.
        observe: is shown every update with the time of receipt, once it is durable, and again when the log is replayed.
        followers: what else snapshots hold: the state of what `observe` feeds, by name.
    """

    def __init__(
        self,
        open_service: Callable[[], CloudService],
        store: Store,
        clock: Callable[[], float] = time.time,
        admit: Admission | None = None,
        observe: Callable[[Update, float], None] | None = None,
        followers: Mapping[str, Follower] | None = None,
    ) -> None:
        self._open_service = open_service
        self.store = store
        self._clock = clock
        self._admission = admit
        self._observe = observe
        self._followers = followers or {}
        self._lock = threading.Lock()
        self._edits = 0
        self._is_torn = False
        self.service = self._recovered(begins=True)

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
            self._mend()
            try:
                return self._take_in(payloads, senders or [None] * len(payloads))
            except BaseException:
                self._tear()
                raise

    def edit(self, edit: SpotEdit, actor: str) -> tuple[int, SpotState | None]:
        """Draw or erase a spot; durable, like diffs, when it returns the version of the parking map and the state.

        Raises:
            RefusedEditError: the spot cannot be so; nothing has changed.
            StoreError: it could not be kept; nothing has changed.
        """
        with self._lock:
            self._mend()
            check_edit(edit, self.service.spots)
            edit = replace(edit, position=self.store.position)
            try:
                state = self.service.edit(edit)
                version = self.store.commit_edit(edit.encoded(), actor, edit.spot_id, state)
            except BaseException:
                self._tear()
                raise
            self._edits += 1
            return version, state

    def mend(self) -> None:
        """Make sure that the store can be read, and that the state is the one that it tells; else `StoreError`."""
        with self._lock:
            self.store.check()
            self._mend()

    def snapshot(self, until: threading.Event | None = None) -> int:
        """Keep the state in the store, so that a new process need not replay the log; returns its position.

        Diffs wait only while tables are copied, not while they are packed and written.

        Args:
            until: take your time, and give up when this is set.

        Raises:
            GivenUpError: `until` was set; the snapshot before it stays.
        """
        with self._lock:
            self._mend()
            position = self.store.position
            kept = self._kept()
        self.store.save_snapshot(position, packed_parts(kept, until))
        return position

    def _kept(self) -> dict[str, Any]:
        kept: dict[str, Any] = {"service": self.service.kept(), "edits": self._edits}
        if self._admission is not None:
            kept["admission"] = self._admission.kept()
        kept["followers"] = {name: follower.kept() for name, follower in self._followers.items()}
        return kept

    def _take_in(self, payloads: Sequence[bytes], senders: Sequence[str | None]) -> list[Update | WireError]:
        settlement = Settlement(self.service)
        refused: dict[int, WireError] = {}
        accepted: list[Accepted] = []
        for number, (payload, sender) in enumerate(zip(payloads, senders, strict=True)):
            try:
                diff, source = self._admitted(payload, sender, accepted)
                taken = settlement.take(diff, len(payload), source)
            except WireError as error:
                refused[number] = _by_itself(error)
                continue
            if taken.change is not None:
                accepted.append(Accepted(diff.session, diff.sequence, self._clock(), bytes(payload)))
                if self._admission is not None:
                    self._admission.note(diff, accepted[-1].received_at, sender)
        updates = settlement.settle()
        new = [update for update in updates if update.accepted]
        if accepted:
            self.store.commit(accepted, {state.spot_id: state for update in new for state in update.spots}.values())
        if self._observe is not None:
            for kept, update in zip(accepted, new, strict=True):
                self._observe(update, kept.received_at)
        left = iter(updates)
        return [refused[number] if number in refused else next(left) for number in range(len(payloads))]

    def _admitted(
        self, payload: bytes, sender: str | None, waiting: list[Accepted]
    ) -> tuple[SemanticMapDiff, int | None]:
        """The diff in some bytes, and whose word it is; raises `WireError` if it is none, or refused."""
        with self.service.times.stage("decode"):
            diff = decode_diff(payload)
        with self.service.times.stage("admission"):
            self._admit(diff, payload, sender, waiting)
            return diff, self._admission.source_of(diff, sender) if self._admission else None

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

    def _tear(self) -> None:
        """The service may hold what could not be kept: take it back, now or before anything else is taken in."""
        self._is_torn = True
        with suppress(StoreError):
            self._mend()

    def _mend(self) -> None:
        if self._is_torn:
            self.service = self._recovered()
            self._is_torn = False

    def _recovered(self, begins: bool = False) -> CloudService:
        """The state after every diff of the log; the stored spots follow it where method or parking map changed."""
        self.store.catch_up()
        edits = [SpotEdit.decoded(data) for data in self.store.spot_edits()]
        self._edits = len(edits)
        oldest = self.store.oldest
        for position, data in self.store.snapshots():
            service = self._restored(data, edits, oldest == 1, begins) if oldest <= position + 1 else None
            if service is not None:
                return self._replayed(service, position, edits)
        if oldest > 1:
            raise StoreError(
                f"{self.store.name}: diffs before number {oldest} have been pruned and no snapshot fits: start the "
                "service with the method and base map that the store was made with, or with a new store"
            )
        service = self._open_service()
        if self._admission is not None:
            self._admission.forget()
        return self._replayed(service, 0, edits)

    def _restored(self, data: bytes, edits: list[SpotEdit], may_replay: bool, begins: bool) -> CloudService | None:
        """The service that a snapshot holds, and `edits` without those that it holds; None if it does not fit."""
        try:
            kept = unpack(data)
            service = self._open_service()
            for edit in edits[: kept["edits"]]:
                service.edit(edit)
            if not service.restore(kept["service"]) and may_replay:
                return None  # of spots that were moved the log may still tell something
            if self._admission is not None:
                self._admission.restore(kept["admission"]) if "admission" in kept else self._admission.forget()
            if begins:  # later they have seen all that is durable
                for name, follower in self._followers.items():
                    if name in kept["followers"]:
                        follower.restore(kept["followers"][name])
        except (SnapshotError, LookupError, TypeError, ValueError) as error:
            _log.warning("%s: a snapshot does not fit, the log tells instead: %s", self.store.name, error)
            return None
        del edits[: kept["edits"]]
        return service

    def _replayed(self, service: CloudService, after: int, edits: list[SpotEdit]) -> CloudService:
        """The service after all diffs of the log after a position, and the edits left."""
        replay = Replay(service, after, edits, self._observe)
        for position, accepted in enumerate(self.store.log(after), start=after + 1):
            try:
                diff = decode_diff(accepted.payload)
                source = self._admission.source_of(diff) if self._admission else None
                replay.take(diff, len(accepted.payload), source, accepted.received_at)
            except WireError as error:
                raise StoreError(
                    f"diff {position} of the store cannot be taken in again: {error}; start the service with the "
                    "parking map and base map that the store was made with"
                ) from error
            if self._admission is not None:
                self._admission.note(diff, accepted.received_at)
        replay.settle()
        known = {state.spot_id: state for state in service.states if state.observed_at is not None}
        if known != {state.spot_id: state for state in self.store.spots()}:
            self.store.replace_spots(known.values())
        return service


def _by_itself(error: WireError) -> WireError:
    """An error without how it came about, which leads to whoever keeps it: memory would fill with such cycles."""
    error.__traceback__ = error.__cause__ = error.__context__ = None
    return error
