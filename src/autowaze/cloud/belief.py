"""What is believed of a spot over time: log-odds of being occupied, fed by evidence, fading with the dwell time.

A spot is a two-state Markov chain (occupied, vacant) that changes once per dwell time; each piece of evidence is a
log-likelihood ratio at a time. Evidence is always taken in the order in which it was observed, so the belief depends
on the set of diffs alone, not on the order of their arrival.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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


def faded_probability(vacant: NDArray[np.float64], elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability (N,) of being vacant a time (N,) after it was `vacant` (N,), without evidence; as `fade`."""
    return np.asarray(0.5 + (vacant - 0.5) * np.exp(-2.0 * np.maximum(elapsed_s, 0.0) / DWELL_S))


def fade(log_odds: float, elapsed_s: float) -> float:
    """Log-odds after a time without evidence."""
    lean = math.tanh(log_odds / 2.0) * math.exp(-2.0 * max(elapsed_s, 0.0) / DWELL_S)
    return math.log1p(lean) - math.log1p(-lean)


def believe(spot_id: str, evidence: list[Evidence], memory: bool = True) -> SpotState:
    """State of a spot after all evidence, as of the newest; without memory only the newest moment counts."""
    if not evidence:
        return SpotState(spot_id, Occupancy.UNKNOWN, evidence="nobody looked")
    ordered = sorted(evidence)
    newest = ordered[-1].observed_at
    if not memory:
        ordered = [item for item in ordered if item.observed_at == newest]
    log_odds, as_of = 0.0, ordered[0].observed_at
    for item in ordered:
        log_odds = fade(log_odds, item.observed_at - as_of) + item.log_odds
        log_odds, as_of = min(max(log_odds, -MOST_LOG_ODDS), MOST_LOG_ODDS), item.observed_at
    said = "; ".join(item.reason for item in ordered if item.observed_at == newest)
    return _state(spot_id, log_odds, newest, said)


def aged(state: SpotState, now: float) -> SpotState:
    """A state as it is believed at a later time: what nobody has looked at for long is unknown again."""
    if state.observed_at is None:
        return state
    log_odds = math.log1p(-state.probability_vacant) - math.log(state.probability_vacant)
    return _state(state.spot_id, fade(log_odds, now - state.observed_at), state.observed_at, state.evidence)


def _state(spot_id: str, log_odds: float, observed_at: float, evidence: str) -> SpotState:
    vacant = 1.0 / (1.0 + math.exp(log_odds))
    occupancy = Occupancy.UNKNOWN
    if vacant >= DECIDED:
        occupancy = Occupancy.VACANT
    elif 1.0 - vacant >= DECIDED:
        occupancy = Occupancy.OCCUPIED
    return SpotState(spot_id, occupancy, vacant, observed_at, evidence)
