"""What vehicles and ground say of a spot, as log-odds of being occupied.

The ground of one pass is one observation, however many windows and frames it spans: its errors (a shift of the car's
position, a wrong ground plane) are common to all of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.belief import Evidence
from autowaze.cloud.cell_kernels import shares_of_passes
from autowaze.cloud.ground_votes import GroundVotes, WindowVotes
from autowaze.cloud.parked_vehicles import GRAZING_OVERLAP, ParkedVehicle, ParkedVehicles
from autowaze.cloud.spots import SpotIndex
from autowaze.cloud.witnesses import Witnesses

PASS_GAP_S = 30.0
"""Windows of a session that are closer in time belong to one pass."""
MOST_LOG_ODDS = 5.0

# On real drives obstacles made up at least 0.35 of what was seen of occupied spots, at most 0.13 of vacant ones.
OBSTACLE_RATIO_EVEN, OBSTACLE_RATIO_EVEN_WHOLE = 0.22, 0.4
"""Where a part of a spot was seen, which may be its free end, and where all was: a short vehicle, half a metre off the
middle, still covers so much of it, and stereo smears what stands next door over less."""
NEARLY_WHOLE_SHARE = 0.75
"""Share of a spot that must be seen for it to count as more than a part."""
LOG_ODDS_PER_OBSTACLE_RATIO = 12.0
ENOUGH_SEEN_SHARE = 0.25
"""Share of a spot that must be seen for its ground to count in full."""
GLIMPSE_SHARE = 0.1
"""Free ground at the mouth of a bay says nothing of its depth."""
FREE_SHARE_EVEN = 0.4
LOG_ODDS_PER_FREE_SHARE = 6.0

PARKED_OVERLAP = 0.5
"""Share of a vehicle that lies in a spot from which on it is parked there."""
MOST_WITNESSES = 64
"""Sources whose word on a vehicle counts, the newest: more make no belief surer, and each costs time at every diff."""
VEHICLE_LOG_ODDS = 4.0
TYPICAL_POINTS = 10.0
POSITION_SIGMA_M = 0.7
"""A car that knows its place no better than this is believed half."""


def evidence_of(
    spots: NDArray[np.int64],
    index: SpotIndex,
    parked: ParkedVehicles,
    votes: GroundVotes,
    witnesses: Witnesses,
    ground: bool = True,
) -> list[list[Evidence]]:
    """All evidence on each of these spots (T,), in no order of time.

    Vehicles count for the spot that they overlap most, if enough of them lies in it: one that stands in the lane
    is not parked. Without `ground` its windows still tell where a car looked and found no vehicle.
    """
    found = []
    for spot, vehicles in parked.around(spots).items():
        middle = core = index.raster(spot).core
        items: list[Evidence] = []
        for vehicle in vehicles:
            if vehicle.home == spot:
                items += _of_vehicle(vehicle, vehicle.shares[spot], witnesses)
            else:  # Half a metre of drift makes it lean over the line, and that must not pass for a vehicle here.
                core = core & ~vehicle.covered(spot, index)
        found.append(items + _of_ground(votes.windows(spot), core, float(core.sum() / middle.sum()), ground))
    return found


def _of_vehicle(vehicle: ParkedVehicle, share: float, witnesses: Witnesses) -> list[Evidence]:
    """One piece of evidence per source that saw points of the vehicle, of the newest sources."""
    parked = min(max((share - GRAZING_OVERLAP) / (PARKED_OVERLAP - GRAZING_OVERLAP), 0.0), 1.0)
    seen: dict[int, tuple[int, float]] = {}
    for session, points, seen_at in vehicle.testimonies:
        source = witnesses.of(session)
        known, last = seen.get(source, (0, 0.0))
        seen[source] = known + points, max(last, seen_at)
    newest = sorted(seen, key=lambda source: (seen[source][1], source))[-MOST_WITNESSES:]
    return [
        Evidence(
            seen_at,
            VEHICLE_LOG_ODDS * parked * points / (points + TYPICAL_POINTS),
            f"vehicle {vehicle.group} of {points} points, {share:.0%} of it here",
            source,
        )
        for source, (points, seen_at) in ((source, seen[source]) for source in newest)
    ]


def _of_ground(windows: list[WindowVotes], core: NDArray[np.bool_], counted: float, ground: bool) -> list[Evidence]:
    """One piece of evidence per pass, from the cells (C,) of a spot that count, a share of those in its middle."""
    if not windows or not core.any():
        return []
    windows = sorted(windows, key=lambda w: (w.session, w.end, w.sequence))
    starts = _pass_starts(windows)
    votes = [*(window.free for window in windows), *(window.obstacle for window in windows)]
    free, obstacle = np.concatenate(votes).reshape(2, len(windows), len(core))
    shares = shares_of_passes(free, obstacle, core, np.array(starts)).tolist()
    found = []
    for first, end, (free_share, obstacle_share) in zip(starts, [*starts[1:], len(windows)], shares, strict=True):
        sigma_m = max(window.sigma_m for window in windows[first:end])
        log_odds = _log_odds(free_share, obstacle_share, counted, ground) / (1.0 + (sigma_m / POSITION_SIGMA_M) ** 2)
        reason = f"ground {free_share:.0%} free, {obstacle_share:.0%} obstacle"
        found.append(Evidence(windows[end - 1].end, log_odds, reason, windows[first].source))
    return found


def _log_odds(free_share: float, obstacle_share: float, counted: float, ground: bool) -> float:
    """Of a pass that saw these shares free and with obstacles of what counts of a spot, its place certain."""
    seen = free_share + obstacle_share
    if not ground:
        return max(-seen, -MOST_LOG_ODDS)
    whole = max(seen * counted - NEARLY_WHOLE_SHARE, 0.0) / (1.0 - NEARLY_WHOLE_SHARE)
    even = OBSTACLE_RATIO_EVEN + (OBSTACLE_RATIO_EVEN_WHOLE - OBSTACLE_RATIO_EVEN) * whole
    lean = obstacle_share / max(seen, 1e-9) - even
    counts_from = GLIMPSE_SHARE if lean < 0 else 0.0
    weight = min(max((seen - counts_from) / (ENOUGH_SEEN_SHARE - counts_from), 0.0), 1.0)
    log_odds = LOG_ODDS_PER_OBSTACLE_RATIO * lean * weight
    log_odds -= LOG_ODDS_PER_FREE_SHARE * max(free_share - FREE_SHARE_EVEN, 0.0)
    return min(max(log_odds, -MOST_LOG_ODDS), MOST_LOG_ODDS)


def _pass_starts(windows: list[WindowVotes]) -> list[int]:
    """First window of each pass, windows sorted by session and time: a pass is of one session, with no long gap."""
    starts = [0]
    for row in range(1, len(windows)):
        before, window = windows[row - 1], windows[row]
        if window.session != before.session or window.end - before.end > PASS_GAP_S:
            starts.append(row)
    return starts
