"""What is believed of a spot over time: log-odds of being occupied, fed by evidence, fading with the dwell time.

A spot is a two-state Markov chain (occupied, vacant) that changes once per dwell time; each piece of evidence is a
log-likelihood ratio at a time. Evidence is always taken in the order in which it was observed, so the belief depends
on the set of diffs alone, not on the order of their arrival.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

from autowaze.world.parking import Occupancy, SpotState

DWELL_S = 3600.0
"""Mean time that a spot stays as it is."""
DECIDED = 0.6
"""A state is called when it is at least this probable; else the spot is unknown."""
MOST_LOG_ODDS = 7.0
"""No number of passes makes a belief surer than this."""


class Evidence(NamedTuple):
    """One observation of a spot; sorts by time.

    Attributes:
        observed_at: seconds since the epoch (UTC).
        log_odds: log of P(seen | occupied) / P(seen | vacant).
        reason: for a person.
    """

    observed_at: float
    log_odds: float
    reason: str


@dataclass(frozen=True)
class Belief:
    """Log-odds of being occupied, as of a time; even odds before any evidence."""

    log_odds: float = 0.0
    as_of: float = -math.inf

    def at(self, time: float) -> Belief:
        """The belief faded to a later time."""
        if not math.isfinite(self.as_of) or time <= self.as_of:
            return replace(self, as_of=max(time, self.as_of))
        kept = math.exp(-2.0 * (time - self.as_of) / DWELL_S)
        lean = math.tanh(self.log_odds / 2.0) * kept
        return Belief(math.log1p(lean) - math.log1p(-lean), time)

    def with_evidence(self, evidence: Evidence) -> Belief:
        """The belief after evidence that is no older than it."""
        faded = self.at(evidence.observed_at)
        log_odds = min(max(faded.log_odds + evidence.log_odds, -MOST_LOG_ODDS), MOST_LOG_ODDS)
        return replace(faded, log_odds=log_odds)

    @property
    def probability_vacant(self) -> float:
        """0..1."""
        return 1.0 / (1.0 + math.exp(self.log_odds))


def believe(spot_id: str, evidence: list[Evidence], memory: bool = True) -> SpotState:
    """State of a spot after all evidence, as of the newest; without memory only the newest moment counts."""
    if not evidence:
        return SpotState(spot_id, Occupancy.UNKNOWN, evidence="nobody looked")
    ordered = sorted(evidence)
    newest = ordered[-1].observed_at
    if not memory:
        ordered = [item for item in ordered if item.observed_at == newest]
    belief = reduce(Belief.with_evidence, ordered, Belief())
    said = "; ".join(item.reason for item in ordered if item.observed_at == newest)
    return _state(spot_id, belief, newest, said)


def aged(state: SpotState, now: float) -> SpotState:
    """A state as it is believed at a later time: what nobody has looked at for long is unknown again."""
    if state.observed_at is None:
        return state
    vacant = min(max(state.probability_vacant, 1e-9), 1.0 - 1e-9)
    belief = Belief(math.log1p(-vacant) - math.log(vacant), state.observed_at).at(now)
    return _state(state.spot_id, belief, state.observed_at, state.evidence)


def _state(spot_id: str, belief: Belief, observed_at: float, evidence: str) -> SpotState:
    vacant = belief.probability_vacant
    occupancy = Occupancy.UNKNOWN
    if vacant >= DECIDED:
        occupancy = Occupancy.VACANT
    elif 1.0 - vacant >= DECIDED:
        occupancy = Occupancy.OCCUPIED
    return SpotState(spot_id, occupancy, vacant, observed_at, evidence)
