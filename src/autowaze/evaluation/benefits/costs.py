"""What metres of searching cost: time, fuel and money at the thesis's rates (thesis, sec. 4.4)."""

from __future__ import annotations

from dataclasses import dataclass

METRES_PER_MILE = 1609.344


@dataclass(frozen=True)
class Rates:
    """How fast one searches, and what a mile costs; the defaults are the thesis's, sec. 4.4.

    Attributes:
        speed_mph: of a car that looks for a spot.
        mileage_mpg: miles per US gallon.
        price_usd: of a gallon.
    """

    speed_mph: float = 10.0
    mileage_mpg: float = 25.0
    price_usd: float = 3.50

    @property
    def speed_mps(self) -> float:
        """Metres per second."""
        return self.speed_mph * METRES_PER_MILE / 3600.0

    def seconds(self, metres: float) -> float:
        """How long it takes."""
        return metres / self.speed_mps

    def gallons(self, metres: float) -> float:
        """How much fuel it takes."""
        return metres / METRES_PER_MILE / self.mileage_mpg

    def dollars(self, metres: float) -> float:
        """What the fuel costs."""
        return self.price_usd * self.gallons(metres)

    def metrics(self, metres: float, name: str) -> dict[str, float]:
        """The four figures of one way, by flat names for reports."""
        return {
            f"{name}_m": metres,
            f"{name}_s": self.seconds(metres),
            f"{name}_gal": self.gallons(metres),
            f"{name}_usd": self.dollars(metres),
        }
