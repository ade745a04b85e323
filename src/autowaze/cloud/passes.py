"""What passes of cars over time say happened at each spot.

A car that drives by sees states, not transitions. One pass gives a report; two passes of which one saw the spot vacant
and the other occupied bracket a change, whose true time lies anywhere between them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from autowaze.cloud.broadcast import Update
from autowaze.world.parking import Occupancy, SpotState

PASS_S = 60.0
"""What is seen within this time is one pass; its last word counts."""
KEPT_HAPPENINGS = 100_000


class Kind(StrEnum):
    """What happened, in the words of CDS."""

    REPORT = "scheduled_report"
    PARK_START = "park_start"
    PARK_END = "park_end"


@dataclass(frozen=True, slots=True)
class Sighting:
    """What was believed of a spot at the end of a pass, decided.

    Attributes:
        observed_at, received_at: seconds since the epoch (UTC).
    """

    state: SpotState
    observed_at: float
    received_at: float

    @property
    def plain(self) -> tuple[Any, ...]:
        """What a snapshot keeps."""
        return (self.state.plain, self.observed_at, self.received_at)

    @classmethod
    def of_plain(cls, plain: list[Any]) -> Sighting:
        """Back from a snapshot."""
        state, observed_at, received_at = plain
        return cls(SpotState.of_plain(state), observed_at, received_at)


@dataclass(frozen=True, slots=True)
class Happening:
    """What a pass says.

    Attributes:
        number: counts happenings from 1, in the order in which passes ended.
        sighting: of the pass.
        not_before: when the last pass saw the opposite, for a start or an end.
    """

    number: int
    kind: Kind
    sighting: Sighting
    not_before: float | None

    @property
    def plain(self) -> tuple[Any, ...]:
        """What a snapshot keeps."""
        return (self.number, self.kind.value, self.sighting.plain, self.not_before)

    @classmethod
    def of_plain(cls, plain: list[Any]) -> Happening:
        """Back from a snapshot."""
        number, kind, sighting, not_before = plain
        return cls(number, Kind(kind), Sighting.of_plain(sighting), not_before)


class PassJournal:
    """Follows the updates of a service. The same updates give the same journal, so a replay of the log rebuilds it."""

    def __init__(self) -> None:
        self._version = -1
        self._before: dict[str, Sighting] = {}
        self._current: dict[str, Sighting] = {}
        self._happenings: deque[Happening] = deque(maxlen=KEPT_HAPPENINGS)
        self._count = 0

    def note(self, update: Update, received_at: float) -> None:
        """Take in an update of the service; one that was taken in before changes nothing."""
        if not update.accepted or update.version <= self._version:
            return
        self._version = update.version
        for state in update.spots:
            if state.observed_at is not None and state.occupancy is not Occupancy.UNKNOWN:
                self._see(Sighting(state, state.observed_at, received_at))

    def happenings(self, now: float) -> list[Happening]:
        """What passes that are over by now say, newest last."""
        for spot_id in [s for s, seen in self._current.items() if seen.observed_at + PASS_S < now]:
            self._settle(spot_id)
        return list(self._happenings)

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot."""
        return {
            "version": self._version,
            "count": self._count,
            "before": list(self._before.values()),
            "current": list(self._current.values()),
            "happenings": list(self._happenings),
        }

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""
        self._version, self._count = kept["version"], kept["count"]
        self._before = {seen.state.spot_id: seen for seen in map(Sighting.of_plain, kept["before"])}
        self._current = {seen.state.spot_id: seen for seen in map(Sighting.of_plain, kept["current"])}
        self._happenings.clear()
        self._happenings.extend(map(Happening.of_plain, kept["happenings"]))

    def _see(self, sighting: Sighting) -> None:
        spot_id = sighting.state.spot_id
        current, before = self._current.get(spot_id), self._before.get(spot_id)
        if before is not None and sighting.observed_at <= before.observed_at + PASS_S:
            return  # a late diff of a pass that was reported already
        if current is not None:
            if sighting.observed_at < current.observed_at:
                return
            if sighting.observed_at > current.observed_at + PASS_S:
                self._settle(spot_id)
        self._current[spot_id] = sighting

    def _settle(self, spot_id: str) -> None:
        sighting, before = self._current.pop(spot_id), self._before.get(spot_id)
        kind, not_before = Kind.REPORT, None
        if before is not None and before.state.occupancy is not sighting.state.occupancy:
            kind = Kind.PARK_START if sighting.state.occupancy is Occupancy.OCCUPIED else Kind.PARK_END
            not_before = before.observed_at
        self._before[spot_id] = sighting
        self._count += 1
        self._happenings.append(Happening(self._count, kind, sighting, not_before))
