"""What a diff must fulfil on the day on which it arrives; the log is replayed without."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.plausibility import Limits, check_plausible, check_removed
from autowaze.cloud.service import CloudService
from autowaze.cloud.store.sources import SourceRegister
from autowaze.cloud.tracks import Tracks
from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.map_diff import SemanticMapDiff

DAY_S = 86_400.0


class ForeignSessionError(RefusedDiffError):
    """The session belongs to another token."""

    def __init__(self) -> None:
        super().__init__("its session belongs to another token: a car draws its own", "foreign_session")


class Admission(Protocol):
    """Decides whether diffs are let in, before they are integrated."""

    def admit(self, diff: SemanticMapDiff, sender: str | None, service: CloudService) -> None:
        """Refuse a diff that was not taken in before with `RefusedDiffError`.

        Args:
            diff: as it came over the wire.
            sender: name of the token that it was handed in with; None where nobody needs one.
            service: that it is for.
        """

    def admit_again(self, diff: SemanticMapDiff, sender: str | None) -> None:
        """Refuse to tell somebody that a diff was taken in before, if it is none of theirs."""

    def source_of(self, diff: SemanticMapDiff, sender: str | None = None) -> int | None:
        """Whose word an admitted diff is, for `CloudService.integrate`; without sender as far as that is known."""

    def note(self, diff: SemanticMapDiff, now: float, sender: str | None = None) -> None:
        """Remember an accepted diff, received now, and whose session it is; on a replay of the log without sender."""

    def forget(self) -> None:
        """Forget all diffs noted: the log is replayed."""

    def kept(self) -> dict[str, Any]:
        """What it remembers, for a snapshot."""

    def restore(self, kept: dict[str, Any]) -> None:
        """Remember what a snapshot kept."""


@dataclass(frozen=True)
class TimelyAdmission:
    """Refuses observations that cannot have been made yet, or so long ago that nobody should act on them.

    Attributes:
        clock: seconds since the epoch (UTC).
        most_ahead_s: how far a car's clock may be ahead.
        most_behind_s: how long an outbox may hold a diff back.
    """

    clock: Callable[[], float]
    most_ahead_s: float = 60.0
    most_behind_s: float = 7 * DAY_S

    def __call__(self, diff: SemanticMapDiff) -> None:
        """Refuse an untimely diff with `RefusedDiffError`."""
        age_s = self.clock() - diff.end
        if age_s < -self.most_ahead_s:
            raise RefusedDiffError(f"it ends {-age_s:.0f} s in the future; set the car's clock", "in_the_future")
        if age_s > self.most_behind_s:
            days = f"{age_s / DAY_S:.1f} days old, {self.most_behind_s / DAY_S:g} at most"
            raise RefusedDiffError(f"it is {days}", "too_old")


class CarefulAdmission:
    """Lets in what the car that holds the token can have seen, and nothing else.

    Args:
        sources: whose session is whose; None where nobody needs a token.
        timely: what must hold of the time of day; None takes drives of another day.
        limits: what a car can do.
    """

    def __init__(
        self,
        sources: SourceRegister | None = None,
        timely: Callable[[SemanticMapDiff], None] | None = None,
        limits: Limits | None = None,
    ) -> None:
        self._sources = sources
        self._timely = timely
        self._limits = limits or Limits()
        self._bounds: NDArray[np.float64] | None = None
        self._tracks = Tracks(self._limits)
        self._spots = -1

    def admit(self, diff: SemanticMapDiff, sender: str | None, service: CloudService) -> None:
        """Refuse a diff with `RefusedDiffError`; see `Admission`."""
        try:
            self._require_own(diff, sender)
            if self._timely is not None:
                self._timely(diff)
            check_plausible(diff, self._area(service), service.map.georeference, self._limits)
            removed = service.map.positions_of(diff.removed), service.map.labels_of(diff.removed)
            check_removed(diff, *removed, self._limits)
            self._tracks.check(diff, self._sources_of(sender))
        except ForeignSessionError:
            raise
        except RefusedDiffError as error:
            raise RefusedDiffError(f"diff {diff.session}/{diff.sequence} refused: {error}", error.reason) from error

    def admit_again(self, diff: SemanticMapDiff, sender: str | None) -> None:
        """Refuse a repeated diff of another token's session."""
        self._require_own(diff, sender)

    def source_of(self, diff: SemanticMapDiff, sender: str | None = None) -> int | None:
        """The source that the session is bound to, or will be."""
        if self._sources is None:
            return None
        bound = self._sources.of_session(diff.session)
        return self._sources_of(sender)[0] if bound is None and sender is not None else bound

    def note(self, diff: SemanticMapDiff, now: float, sender: str | None = None) -> None:
        """Remember an accepted diff."""
        if self._sources is not None and sender is not None:
            self._sources.bind(diff.session, sender)
        self._tracks.note(diff, self.source_of(diff) or 0, now)

    def forget(self) -> None:
        """Forget all diffs noted."""
        self._tracks = Tracks(self._limits)

    def kept(self) -> dict[str, Any]:
        """What it remembers of the diffs noted."""
        return self._tracks.kept()

    def restore(self, kept: dict[str, Any]) -> None:
        """Remember what a snapshot kept."""
        self._tracks.restore(kept)

    def _area(self, service: CloudService) -> NDArray[np.float64] | None:
        """Bounds (4,) of all spots; found again when there are more or fewer, since that costs all of them."""
        if len(service.spots) != self._spots:
            self._spots = len(service.spots)
            bounds = service.spots.bounds
            self._bounds = np.append(bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)) if self._spots else None
        return self._bounds

    def _sources_of(self, sender: str | None) -> tuple[int, ...]:
        return self._sources.of_token(sender) if self._sources is not None and sender is not None else ()

    def _require_own(self, diff: SemanticMapDiff, sender: str | None) -> None:
        if sender is not None and self._sources is not None and not self._sources.may_use(diff.session, sender):
            raise ForeignSessionError
