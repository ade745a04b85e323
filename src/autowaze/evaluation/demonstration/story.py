"""What happens in the demonstration: two streets are surveyed, and three cars drive through them another day."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from autowaze.simulator import StreetDescription, load_description
from autowaze.simulator.plan.street_plan import plan_street
from autowaze.world.georeference import Georeference

_STREETS = ("town-a", "town-b")
_TOWN = Georeference(43.0845, -77.6749, 150.0)
_PLACES_M = ((0.0, 0.0), (118.0, 46.0))
"""Where the streets begin, east and north in the map."""
_TWO_O_CLOCK = 1_718_219_442.0
"""By the sun over the town, seconds since the epoch; that is how the light falls."""
_SURVEYED_BEFORE_S = 86_400.0
_LATER_S = 1200.0
_VACANT, _LEAVING = 1 / 3, 1 / 5
"""Shares of a street's spots: those that are free, and those free ones that others have become by the last drive."""
_EGO = {"fps": 6.0, "speed_kmh": 24.0}
"""A frame every metre is enough to localise by; on two cores rendering costs most of the demonstration's time."""


@dataclass(frozen=True)
class Drive:
    """One drive through one street.

    Attributes:
        name: what people call it; names its folder, too.
        street: which one, by its number in the story.
    """

    name: str
    street: int
    description: StreetDescription


@dataclass(frozen=True)
class Story:
    """All drives.

    Attributes:
        surveys: one per street, in their order; the day before, when other cars are parked.
        first: cars that drive at the same time.
        later: a car that comes through the street of the first one when some cars have left and others have come.
    """

    surveys: tuple[Drive, ...]
    first: tuple[Drive, ...]
    later: Drive

    @property
    def drives(self) -> tuple[Drive, ...]:
        """All of them, in the order of time."""
        return (*self.surveys, *self.first, self.later)

    @property
    def cars(self) -> tuple[Drive, ...]:
        """Those that the service hears of."""
        return (*self.first, self.later)

    @property
    def georeference(self) -> Georeference:
        """Of the map frame: that of the first street."""
        origin = self.surveys[0].description
        return Georeference(origin.latitude, origin.longitude, origin.altitude_m)


def tell(seed: int = 1, **changes: Any) -> Story:
    """The story of a seed: it says which spots are free, which cars are parked, and who else is about.

    Args:
        seed: from 1 on.
        changes: members of the streets' descriptions, as for `load_description`.
    """
    rng = np.random.default_rng(seed)
    ego, parks = _EGO | changes.pop("ego", {}), changes.pop("parking", {})

    def drive(name: str, street: int, number: int, at_s: float, **parking: Any) -> Drive:
        east, north = _PLACES_M[street]
        lon, lat = _TOWN.to_lon_lat(np.array([[east, north]]))[0].tolist()
        description = load_description(
            _STREETS[street],
            drive=number,
            latitude=lat,
            longitude=lon,
            altitude_m=_TOWN.altitude_m,
            ego=ego | {"start_time": _TWO_O_CLOCK + at_s},
            light={"solar_time": 14.0 + max(at_s, 0.0) / 3600.0},
            parking=parks | parking,
            **changes,
        )
        return Drive(name, street, description)

    surveys = tuple(drive(f"survey {n + 1}", n, 0, -_SURVEYED_BEFORE_S) for n in range(len(_STREETS)))
    shuffled = [rng.permutation([bay.id for bay in plan_street(s.description).bays]).tolist() for s in surveys]
    own = 10 * seed

    def free(spots: list[str], left: int = 0) -> list[str]:
        return spots[left : left + round(_VACANT * len(spots))]

    first = tuple(
        drive(f"car {n + 1}", n, own + n, 0.0, occupancy=1.0, vacant=free(spots)) for n, spots in enumerate(shuffled)
    )
    others = free(shuffled[0], round(_LEAVING * len(shuffled[0])))
    later = drive(f"car {len(first) + 1}", 0, own + len(first), _LATER_S, occupancy=1.0, vacant=others, drive=own)
    return Story(surveys, first, later)
