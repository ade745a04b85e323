"""What the quick experiments must reach: less means that a change has cost accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Guard:
    """A bound on one figure.

    Attributes:
        result: name of the result, metric: name of the figure in it.
        at_least, at_most: what it must keep to.
    """

    result: str
    metric: str
    at_least: float = float("-inf")
    at_most: float = float("inf")

    def breach(self, results: Mapping[str, Mapping[str, float]]) -> str | None:
        """What is wrong in words; None if nothing is."""
        value = results.get(self.result, {}).get(self.metric)
        if value is None:
            return f"{self.result}: {self.metric} was not measured"
        if self.at_least <= value <= self.at_most:
            return None
        bound = f"at least {self.at_least:g}" if value < self.at_least else f"at most {self.at_most:g}"
        return f"{self.result}: {self.metric} is {value:.4g}, must be {bound}"


GUARDS = (
    Guard("town, fused", "accuracy", at_least=0.95),
    Guard("town, fused", "precision", at_least=0.9),
    Guard("town, fused", "unseen_vacant", at_most=0),
    Guard("town, thesis", "unseen_vacant", at_most=0),
    Guard("town, fused", "own_car", at_least=0.9),
    Guard("town, fused", "centre_median_m", at_most=0.3),
    Guard("town, sent", "diff_bytes_median", at_most=6_000),
    Guard("real-world-like, fused", "accuracy", at_least=0.9),
    Guard("real-world-like, fused", "unseen_vacant", at_most=0),
    Guard("real-world-like, sent", "diff_bytes_median", at_most=6_000),
    Guard("real-world-like, driven", "localized_fraction", at_least=0.9),
)


def breaches(results: Mapping[str, Mapping[str, float]], guards: tuple[Guard, ...] = GUARDS) -> list[str]:
    """What is below its bound, in words."""
    return [words for guard in guards if (words := guard.breach(results)) is not None]
