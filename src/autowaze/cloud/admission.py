"""What a diff must fulfil on the day on which it arrives; the log is replayed without."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from autowaze.cloud.validation import RefusedDiffError
from autowaze.world.map_diff import SemanticMapDiff

DAY_S = 86_400.0


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
        name = f"diff {diff.session}/{diff.sequence} refused"
        if age_s < -self.most_ahead_s:
            raise RefusedDiffError(f"{name}: it ends {-age_s:.0f} s in the future; set the car's clock")
        if age_s > self.most_behind_s:
            raise RefusedDiffError(
                f"{name}: it is {age_s / DAY_S:.1f} days old, {self.most_behind_s / DAY_S:g} at most"
            )
