"""What a store promises: a log of accepted diffs, and the spots as of a position in it, always together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from autowaze.cloud.store.database import StoreError
from autowaze.world.parking import ParkingMap, SpotState

__all__ = ["Accepted", "AuditEntry", "SpotChange", "Store", "StoreError"]


@dataclass(frozen=True)
class Accepted:
    """One accepted diff.

    Attributes:
        session, sequence: key of the diff.
        received_at: seconds since the epoch (UTC).
        payload: the bytes that the car sent.
    """

    session: int
    sequence: int
    received_at: float
    payload: bytes


@dataclass(frozen=True)
class SpotChange:
    """A spot that a commit changed.

    Attributes:
        number: counts changes from 1.
        received_at: of the newest diff of the commit, seconds since the epoch (UTC).
        state: the spot since then; the history keeps no evidence.
    """

    number: int
    received_at: float
    state: SpotState


@dataclass(frozen=True)
class AuditEntry:
    """Who did, or was refused, what.

    Attributes:
        number: counts entries from 1; the store gives it, whatever an entry says that is handed in.
        at: seconds since the epoch (UTC).
        actor: name of the token, never its secret; empty for nobody known.
        action: what was done, one word or two.
        detail: one line for a person.
    """

    number: int
    at: float
    actor: str
    action: str
    detail: str


class Store(Protocol):
    """An append-only log of diffs, numbered from 1, and the state of every spot after the last of them.

    `log`, `commit`, `commit_edit` and `replace_spots` belong to one thread; all else may be called from any.

    Attributes:
        name: where it lies, without secrets.
    """

    name: str

    @property
    def position(self) -> int:
        """Number of the last diff in the log; 0 for none."""

    @property
    def oldest(self) -> int:
        """Number of the oldest diff that is still in the log; of the next one, if there is none."""

    def check(self) -> None:
        """Raise `StoreError` if the database does not answer."""

    def catch_up(self) -> None:
        """Read again how far the log goes: a commit of which no answer came may have been kept."""

    def log(self, after: int = 0) -> Iterator[Accepted]:
        """Diffs after a position, in order."""

    def commit(self, accepted: Iterable[Accepted], changed: Iterable[SpotState]) -> int:
        """Append diffs and the spot states that they changed, all or nothing; returns the new position.

        Once it returns the diffs survive the end of the process and of the machine.

        Raises:
            StoreError: nothing was kept.
        """

    def replace_spots(self, states: Iterable[SpotState]) -> None:
        """Put these states in place of all that are kept; raises `StoreError` as `commit` does."""

    def payload(self, session: int, sequence: int) -> bytes | None:
        """The bytes of the diff with this key; None where the log has none, or has it no longer."""

    def spots(self) -> list[SpotState]:
        """The states kept, in no order."""

    def history(self, start: float, end: float, limit: int, after: int = 0) -> list[SpotChange]:
        """Changes received from start to end, both included, seconds since the epoch, by number, after a number."""

    def history_extent(self) -> tuple[float, float] | None:
        """When the oldest and the newest change kept were received; None without any."""

    def spots_at(self, time: float) -> list[SpotState]:
        """The newest state per spot received at or before a time, in no order; spots without any are left out."""

    def audit(self, entry: AuditEntry) -> None:
        """Note who did what; raises `StoreError` if it could not be kept."""

    def audit_entries(self, after: int = 0, limit: int = 1000) -> list[AuditEntry]:
        """Entries after a number, oldest first."""

    def commit_edit(self, geojson: bytes, actor: str, spot_id: str, state: SpotState | None) -> int:
        """Keep an edit of the parking map beside those before it, and what it made of its spot, all or nothing.

        Args:
            geojson: the edit; see `cloud.spot_edits`.
            actor: who made it.
            spot_id, state: the spot; None if it was erased.

        Returns:
            The version of the parking map: 1 for the first edit, and growing.

        Raises:
            StoreError: nothing was kept.
        """

    def spot_edits(self) -> Iterator[bytes]:
        """Every edit of the parking map, oldest first."""

    def save_snapshot(self, position: int, parts: Iterable[bytes]) -> None:
        """Keep the state after a position, some bytes after the other; of older snapshots the newest stays.

        What the parts raise goes through, and then nothing has changed.
        """

    def snapshots(self) -> Iterator[tuple[int, bytes]]:
        """Snapshots, newest first, each with its position; damaged ones are left out."""

    def prune(self, diffs_before: float, history_before: float) -> int:
        """Delete diffs received before a time, and history and audit entries before another; seconds since the epoch.

        The log is only pruned as far as two snapshots cover it. Returns the number of diffs deleted.
        """

    def tidy(self) -> None:
        """Do what commits should not wait for; wants to be called every minute or so of a service that is busy."""

    def survey(self, parking_map: ParkingMap) -> None:
        """Note where the spots lie, where the database can show it to GIS tools."""

    def close(self) -> None:
        """Let go of the file or connection."""
