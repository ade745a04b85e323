"""Where and when the cars of late were: what the next diff of a car has to agree with.

Windows of a session lie one after the other in time as their numbers do, and a car gets from one to the next no
faster than it drives. Runs of windows without gaps are kept as one, so a day's drive costs a few numbers.
"""

from __future__ import annotations

import math
from bisect import bisect
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from autowaze.cloud.plausibility import Limits
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.map_diff import SemanticMapDiff

MOST_RUNS = 32
"""Gaps of a session that may still be filled; older ones are closed."""
MOST_SESSIONS = 256
"""Sessions of a source at a time; a car draws one per drive."""
MOST_TRACKS = 1 << 17
KEPT_S = 8 * 86_400.0
"""A day longer than an outbox may hold a diff back."""
OVERLAP_S = 0.5
"""Windows may overlap by so much: clocks are read per frame."""
STEPPED_CLOCK_S = 60.0
"""A car that starts again may find its clock set back by so much."""
SHORTEST_WINDOW_S = 0.5
SPARE_NUMBERS = 16


class Fix(NamedTuple):
    """A place at a time: seconds since the epoch, metres in the map frame."""

    time: float
    x: float
    y: float


@dataclass
class Run:
    """Windows `first` to `last` of a session, all received; a run of which no window knew its place has no fixes."""

    first: int
    last: int
    start: float
    end: float
    entry: Fix | None
    exit: Fix | None


@dataclass
class _Session:
    source: int
    runs: list[Run] = field(default_factory=list)
    noted_at: float = 0.0


class Tracks:
    """The sessions of the last days, by number and by source.

    Args:
        limits: what a car can do.
    """

    def __init__(self, limits: Limits | None = None) -> None:
        self._limits = limits or Limits()
        self._sessions: OrderedDict[int, _Session] = OrderedDict()
        self._of_source: dict[int, set[int]] = {}

    def __len__(self) -> int:
        return len(self._sessions)

    def check(self, diff: SemanticMapDiff, sources: Iterable[int] = ()) -> None:
        """Refuse a diff that does not fit what its session, or another one of these sources, reported before.

        Raises:
            RefusedDiffError: back-dated, numbered too far ahead, too far away, or from two places at once.
        """
        window = _run_of(diff)
        session = self._sessions.get(diff.session)
        if session is not None:
            self._check_session(window, session.runs)
        others = {number for source in sources for number in self._of_source.get(source, ())} - {diff.session}
        if session is None and len(others) >= MOST_SESSIONS:
            raise RefusedDiffError(f"more than {MOST_SESSIONS} sessions within a day or two", "too_many_sessions")
        for number in others:
            for run in self._sessions[number].runs:
                self._check_other(window, run)

    def note(self, diff: SemanticMapDiff, source: int, now: float) -> None:
        """Remember an accepted diff of a source, 0 for none known; now is the time of receipt."""
        session = self._sessions.get(diff.session)
        if session is None:
            session = self._sessions[diff.session] = _Session(source)
            if source:
                self._of_source.setdefault(source, set()).add(diff.session)
        session.noted_at = now
        self._sessions.move_to_end(diff.session)
        _insert(session.runs, _run_of(diff))
        while self._sessions and (
            len(self._sessions) > MOST_TRACKS or next(iter(self._sessions.values())).noted_at < now - KEPT_S
        ):
            self._forget(next(iter(self._sessions)))

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot."""
        sessions = [
            (n, s.source, s.noted_at, [(r.first, r.last, r.start, r.end, r.entry, r.exit) for r in s.runs])
            for n, s in self._sessions.items()
        ]
        return {"sessions": sessions}

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""
        self._sessions.clear()
        self._of_source.clear()
        for number, source, noted_at, runs in kept["sessions"]:
            self._sessions[number] = _Session(source, [Run(*run[:4], *map(_fix, run[4:])) for run in runs], noted_at)
            if source:
                self._of_source.setdefault(source, set()).add(number)

    def _forget(self, number: int) -> None:
        session = self._sessions.pop(number)
        siblings = self._of_source.get(session.source, set())
        siblings.discard(number)
        if not siblings:
            self._of_source.pop(session.source, None)

    def _check_session(self, window: Run, runs: list[Run]) -> None:
        place = bisect(runs, window.first, key=lambda run: run.first)
        before = runs[place - 1] if place else None
        after = runs[place] if place < len(runs) else None
        if before is not None:
            if window.first <= before.last:
                raise RefusedDiffError("its number is taken, or too late to come", "replayed")
            if window.start < before.end - OVERLAP_S:
                raise RefusedDiffError("it begins before the window before it ended", "back_dated")
            self._check_numbers(before, window)
            self._check_way(before.exit, window.entry, "too_fast")
        if after is not None:
            if window.end > after.start + OVERLAP_S:
                raise RefusedDiffError("it ends after the window after it began", "back_dated")
            self._check_numbers(window, after)
            self._check_way(window.exit, after.entry, "too_fast")

    def _check_other(self, window: Run, run: Run) -> None:
        """Cars draw a new session when they start again, never while another one goes on."""
        within_s = min(run.end - window.start, window.end - run.start)
        if within_s > STEPPED_CLOCK_S:
            raise RefusedDiffError("its token reports in another session at that time", "two_places")
        self._check_way(run.exit, window.entry, "two_places")
        self._check_way(window.exit, run.entry, "two_places")

    def _check_way(self, start: Fix | None, end: Fix | None, reason: str) -> None:
        if start is None or end is None:
            return
        way_m, time_s = math.hypot(end.x - start.x, end.y - start.y), abs(end.time - start.time)
        if way_m > self._limits.most_speed_mps * time_s + self._limits.most_jump_m:
            raise RefusedDiffError(f"its car was {way_m:.0f} m away {time_s:.0f} s before or after", reason)

    @staticmethod
    def _check_numbers(before: Run, after: Run) -> None:
        most = (after.end - before.end) / SHORTEST_WINDOW_S + SPARE_NUMBERS
        if after.first - before.last > most:
            skipped = after.first - before.last
            raise RefusedDiffError(f"its number is {skipped} ahead: more windows than there was time for", "numbering")


def _fix(plain: list[float] | None) -> Fix | None:
    return None if plain is None else Fix(*plain)


def _run_of(diff: SemanticMapDiff) -> Run:
    path = diff.trajectory
    fixes = (
        [Fix(float(path.time[row]), *path.position[row, :2].tolist()) for row in (0, -1)] if len(path) else [None] * 2
    )
    return Run(diff.sequence, diff.sequence, diff.start, diff.end, fixes[0], fixes[1])


def _insert(runs: list[Run], window: Run) -> None:
    """Put a window in its place and join what has no gap left; of too many gaps the oldest is closed."""
    place = bisect(runs, window.first, key=lambda run: run.first)
    runs.insert(place, window)
    for left in (place, place - 1):
        if 0 <= left < len(runs) - 1 and runs[left].last + 1 == runs[left + 1].first:
            _join(runs, left)
    if len(runs) > MOST_RUNS:
        _join(runs, 0)


def _join(runs: list[Run], left: int) -> None:
    a, b = runs[left], runs.pop(left + 1)
    runs[left] = Run(a.first, b.last, a.start, b.end, a.entry or b.entry, b.exit or a.exit)
