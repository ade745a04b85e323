"""What is believed of a spot over time: log-odds of being occupied, fed by evidence, fading with the dwell time.

A spot is a two-state Markov chain (occupied, vacant) that changes once per dwell time; each piece of evidence is a
log-likelihood ratio at a time. Evidence is always taken in the order in which it was observed, so the belief depends
on the set of diffs alone, not on the order of their arrival.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
CALLED_LOG_ODDS = math.log(DECIDED / (1.0 - DECIDED))
SHAKEN_LOG_ODDS = math.log(3.0)
"""What one who contradicts several leaves of their belief: three to one."""


class Evidence(NamedTuple):
    """One observation of a spot; sorts by time.

    Attributes:
        observed_at: seconds since the epoch (UTC).
        log_odds: log of P(seen | occupied) / P(seen | vacant).
        reason: for a person.
        source: whose word it is; see `cloud.witnesses`.
    """

    observed_at: float
    log_odds: float
    reason: str
    source: int = 0


def faded_probability(vacant: NDArray[np.float64], elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability (N,) of being vacant a time (N,) after it was `vacant` (N,), without evidence; as `fade`."""
    return np.asarray(0.5 + (vacant - 0.5) * np.exp(-2.0 * np.maximum(elapsed_s, 0.0) / DWELL_S))


def fade(log_odds: float, elapsed_s: float) -> float:
    """Log-odds after a time without evidence."""
    lean = math.tanh(log_odds / 2.0) * math.exp(-2.0 * max(elapsed_s, 0.0) / DWELL_S)
    return math.log1p(lean) - math.log1p(-lean)


def believe(spot_id: str, evidence: list[Evidence], memory: bool = True, corroboration: bool = True) -> SpotState:
    """State of a spot after all evidence, as of the newest.

    Args:
        spot_id: of the spot.
        evidence: in any order.
        memory: else only the newest moment counts.
        corroboration: each source counts once, and none alone overturns what others agree on; else all evidence is
            taken as if each piece came from somebody else.
    """
    if not evidence:
        return SpotState(spot_id, Occupancy.UNKNOWN, evidence="nobody looked")
    ordered = sorted(evidence)
    newest = ordered[-1].observed_at
    if not memory:
        ordered = [item for item in ordered if item.observed_at == newest]
    said = "; ".join(item.reason for item in ordered if item.observed_at == newest)
    if corroboration and any(item.source != ordered[0].source for item in ordered):
        log_odds, doubt = _weighed(_testimonies(ordered))
        said += doubt
    else:
        log_odds = _accumulated(ordered)
    return _state(spot_id, log_odds, newest, said)


def _accumulated(ordered: Sequence[Evidence]) -> float:
    """Log-odds after evidence in order of time, at the time of the last; 0 without any."""
    log_odds, as_of = 0.0, ordered[0].observed_at if ordered else 0.0
    for item in ordered:
        log_odds = fade(log_odds, item.observed_at - as_of) + item.log_odds
        log_odds, as_of = min(max(log_odds, -MOST_LOG_ODDS), MOST_LOG_ODDS), item.observed_at
    return log_odds


def _testimonies(ordered: Sequence[Evidence]) -> list[Evidence]:
    """What each source by itself believes, as of when it looked last: said a thousand times, a thing is said once."""
    of_source: dict[int, list[Evidence]] = {}
    for item in ordered:
        of_source.setdefault(item.source, []).append(item)
    return sorted(items[-1]._replace(log_odds=_accumulated(items)) for items in of_source.values())


def _weighed(testimonies: list[Evidence]) -> tuple[float, str]:
    """Log-odds after one testimony per source, in order of time; and a word on who is doubted.

    A state is corroborated by the two newest sources that by themselves still call it. Who contradicts it later, alone,
    can shake it but not overturn it, for as long as all others together still call it: two can lie no easier than one
    can be wrong. A second source that agrees, or time, settles it.
    """
    log_odds, now = _accumulated(testimonies), testimonies[-1].observed_at
    for side in (1.0, -1.0):
        voices = [(item, side * fade(item.log_odds, now - item.observed_at)) for item in testimonies]
        agreeing = [item.observed_at for item, odds in voices if odds >= CALLED_LOG_ODDS]
        if len(agreeing) < 2:
            continue
        against = [item for item, odds in voices if odds <= -CALLED_LOG_ODDS and item.observed_at >= agreeing[-2]]
        if len(against) != 1:
            continue
        others = [item for item in testimonies if item is not against[0]]
        held = side * fade(_accumulated(others), now - others[-1].observed_at)
        if held >= CALLED_LOG_ODDS and side * log_odds < min(held, SHAKEN_LOG_ODDS):
            return side * min(held, SHAKEN_LOG_ODDS), f"; one against {len(agreeing)} who saw otherwise"
    return log_odds, ""


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
