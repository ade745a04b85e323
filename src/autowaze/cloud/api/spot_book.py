"""The spots as clients see them: geometry worked out once, states as believed at the moment of asking."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.api.intake import Intake
from autowaze.cloud.api.spot_sheet import Rectangle, SpotSheet
from autowaze.cloud.belief import DECIDED, aged, faded_probability
from autowaze.cloud.service import CloudService
from autowaze.world.parking import Occupancy, ParkingMap, SpotState

_CALLED = (Occupancy.VACANT, Occupancy.OCCUPIED, Occupancy.UNKNOWN)


class FadingStates(Sequence[SpotState]):
    """States as believed at a time, each worked out when it is looked at: a city has many, a client wants few.

    Args:
        as_observed: states when last observed.
        now: seconds since the epoch (UTC).
        fades: whether beliefs fade; those of methods without belief do not.
    """

    def __init__(self, as_observed: Sequence[SpotState], now: float, fades: bool) -> None:
        self._as_observed = as_observed
        self._now = now
        self.fades = fades

    def __len__(self) -> int:
        return len(self._as_observed)

    @overload
    def __getitem__(self, row: int) -> SpotState: ...
    @overload
    def __getitem__(self, row: slice) -> FadingStates: ...
    def __getitem__(self, row: int | slice) -> SpotState | FadingStates:
        if isinstance(row, slice):
            return FadingStates(self._as_observed[row], self._now, self.fades)
        state = self._as_observed[row]
        return aged(state, self._now) if self.fades else state

    def probabilities(self, rows: NDArray[np.int64], later_s: float = 0.0) -> NDArray[np.float64]:
        """Probability (N,) that each of the spots (N,) is vacant some seconds from now."""
        states = [self._as_observed[row] for row in rows.tolist()]
        vacant = np.array([state.probability_vacant for state in states], dtype=np.float64)
        if not self.fades and later_s == 0.0:
            return vacant
        observed_at = [self._now if state.observed_at is None else state.observed_at for state in states]
        since = self._now - np.array(observed_at) if self.fades else np.zeros(len(states))
        return faded_probability(vacant, np.maximum(since, 0.0) + later_s)

    def occupancies(self, rows: NDArray[np.int64]) -> list[Occupancy]:
        """What each of the spots (N,) is called."""
        if not self.fades:
            return [self._as_observed[row].occupancy for row in rows.tolist()]
        vacant = self.probabilities(rows)
        seen = np.array([moment is not None for moment in self.observed_at(rows)], dtype=np.bool_)
        code = np.where(seen & (vacant >= DECIDED), 0, np.where(seen & (1.0 - vacant >= DECIDED), 1, 2))
        return [_CALLED[c] for c in code.tolist()]

    def observed_at(self, rows: NDArray[np.int64]) -> list[float | None]:
        """When each of the spots (N,) was last observed, seconds since the epoch (UTC)."""
        return [self._as_observed[row].observed_at for row in rows.tolist()]

    def counts(self) -> dict[Occupancy, int]:
        """How many spots are in each state."""
        found = Counter(self.occupancies(np.arange(len(self))))
        return {state: found[state] for state in Occupancy}


@dataclass(frozen=True)
class BelievedSpots:
    """All spots at one time.

    Attributes:
        states: in the order of the parking map.
        now: seconds since the epoch (UTC).
        version: of the map that they follow from.
        sheet: where they lie; the rows are those of `states`.
    """

    states: FadingStates
    now: float
    version: int
    sheet: SpotSheet

    def feature(self, row: int) -> dict[str, Any]:
        """One spot as a GeoJSON feature."""
        state, sheet = self.states[row], self.sheet
        seen = state.observed_at
        return {
            "type": "Feature",
            "id": sheet.ids[row],
            "geometry": sheet.geometries[row],
            "properties": {
                "spot_id": sheet.ids[row],
                "kind": sheet.kinds[row],
                "state": state.occupancy.value,
                "probability": round(state.probability_vacant, 4),
                "observed_at": seen,
                "age_s": None if seen is None else round(max(self.now - seen, 0.0), 1),
                "rectangle": sheet.rectangles[row],
            },
        }


class SpotBook:
    """Looks spots up for the feeds.

    Args:
        parking_map: the spots.
        intake: where their states are asked for.
        clock: seconds since the epoch (UTC); None stands still at the newest observation, to replay drives of old.

    Attributes:
        sheet: where the spots lie now. Rows change when spots are drawn or erased: whoever looks at states, too, takes
            the sheet that comes with them.
    """

    def __init__(self, parking_map: ParkingMap, intake: Intake, clock: Callable[[], float] | None) -> None:
        self.sheet = SpotSheet(parking_map)
        self._intake = intake
        self._clock = clock

    def __len__(self) -> int:
        return len(self.sheet)

    def turn_to(self, sheet: SpotSheet) -> None:
        """Spots lie there from now on; to be called in the thread of the service, together with the edit."""
        self.sheet = sheet

    async def believed(self) -> BelievedSpots:
        """Every spot as it is believed now."""
        return await self._intake.ask(self._believed)

    def vacant_rectangles(self, spots: BelievedSpots) -> list[Rectangle]:
        """Rectangles of the vacant spots (thesis, sec. 3.3.6)."""
        pairs = zip(spots.sheet.rectangles, spots.states, strict=True)
        return [rectangle for rectangle, state in pairs if state.occupancy is Occupancy.VACANT]

    def _believed(self, service: CloudService) -> BelievedSpots:
        if self._clock is None:
            now = max((s.observed_at for s in service.states if s.observed_at is not None), default=0.0)
        else:
            now = self._clock()
        states = FadingStates(service.states, now, service.method.belief)
        return BelievedSpots(states, now, service.map.version, self.sheet)
