"""What a store promises: a log of accepted diffs, and the spots as of a position in it, always together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from autowaze.world.errors import AutowazeError
from autowaze.world.parking import SpotState


class StoreError(AutowazeError):
    """The store cannot be opened, or did not keep what it was given; what it held before is intact."""


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


class Store(Protocol):
    """An append-only log of diffs, numbered from 1, and the state of every spot after the last of them."""

    @property
    def position(self) -> int:
        """Number of the last diff in the log; 0 for none."""

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

    def spots(self) -> list[SpotState]:
        """The states kept, in no order."""

    def close(self) -> None:
        """Let go of the file or connection."""
