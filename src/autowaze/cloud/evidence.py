"""What vehicles and ground say of a spot, as log-odds of being occupied.

The ground of one pass is one observation, however many windows and frames it spans: its errors (a shift of the car's
position, a wrong ground plane) are common to all of them.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.cloud.belief import Evidence
from autowaze.cloud.cell_kernels import shares_of_passes
from autowaze.cloud.ground_votes import GroundVotes, WindowVotes
from autowaze.cloud.merging import MergedVehicles, vehicles_at
from autowaze.cloud.scene import VehicleScene
from autowaze.cloud.spots import SpotIndex, SpotRaster
from autowaze.cloud.witnesses import Witnesses
from autowaze.world.identity import session_of_key

PASS_GAP_S = 30.0
"""Windows of a session that are closer in time belong to one pass."""
MOST_LOG_ODDS = 5.0

# On real drives obstacles made up at least 0.35 of what was seen of occupied spots, at most 0.13 of vacant ones.
OBSTACLE_RATIO_EVEN = 0.22
LOG_ODDS_PER_OBSTACLE_RATIO = 12.0
ENOUGH_SEEN_SHARE = 0.25
"""Share of a spot that must be seen for its ground to count in full."""
GLIMPSE_SHARE = 0.1
"""Free ground at the mouth of a bay says nothing of its depth."""
FREE_SHARE_EVEN = 0.4
LOG_ODDS_PER_FREE_SHARE = 6.0

PARKED_OVERLAP = 0.5
"""Share of a vehicle that lies in a spot from which on it is parked there."""
GRAZING_OVERLAP = 0.25
LEANING_RIM_M = 0.25
VEHICLE_LOG_ODDS = 4.0
TYPICAL_POINTS = 10.0
POSITION_SIGMA_M = 0.7
"""A car that knows its place no better than this is believed half."""


def evidence_of(
    spots: NDArray[np.int64],
    index: SpotIndex,
    scene: VehicleScene,
    votes: GroundVotes,
    witnesses: Witnesses,
    ground: bool = True,
) -> list[list[Evidence]]:
    """All evidence on each of these spots (T,), in no order of time.

    Vehicles count for the spot that they overlap most, if enough of them lies in it: one that stands in the lane
    is not parked. Without `ground` its windows still tell where a car looked and found no vehicle.
    """
    merged = vehicles_at(index.polygons[spots], scene)
    vehicles = merged.vehicles
    footprints = vehicles.polygons
    row, spot = index.overlapping(footprints)
    common = shapely.area(shapely.intersection(footprints[row], index.polygons[spot]))
    share = common / (vehicles.length * vehicles.width)[row]
    is_home = _is_best(row, spot, share) & (share >= GRAZING_OVERLAP)
    found = []
    for one in spots.tolist():
        here = spot == one
        at_home, leaning = row[here & is_home], row[here & ~is_home]
        core = _not_covered(index.raster(one), footprints[leaning])
        shares = share[here & is_home].tolist()
        items = [
            item for r, s in zip(at_home.tolist(), shares, strict=True) for item in _of_vehicle(merged, r, s, witnesses)
        ]
        found.append(items + _of_ground(votes.windows(one), core, ground))
    return found


def _is_best(row: NDArray[np.int64], spot: NDArray[np.int64], share: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which pairs (N,) of a vehicle and a spot are the one that the vehicle overlaps most."""
    order = np.lexsort((spot, -share, row))
    best = np.zeros(len(row), np.bool_)
    best[order[np.unique(row[order], return_index=True)[1]]] = True
    return best


def _not_covered(raster: SpotRaster, footprints: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Which cells (C,) of a spot speak for it: those at its core that no vehicle covers that stands elsewhere.

    Half a metre of drift makes the neighbour lean over the line, and that must not pass for a vehicle here.
    """
    if len(footprints) == 0:
        return raster.core
    grown = shapely.union_all(shapely.buffer(footprints, LEANING_RIM_M))
    return np.asarray(raster.core & ~shapely.contains_xy(grown, raster.centre))


def _of_vehicle(merged: MergedVehicles, row: int, share: float, witnesses: Witnesses) -> list[Evidence]:
    """One piece of evidence per source that saw points of the vehicle."""
    parked = float(np.clip((share - GRAZING_OVERLAP) / (PARKED_OVERLAP - GRAZING_OVERLAP), 0.0, 1.0))
    parts = merged.parts[merged.whole == row]
    seen: dict[int, tuple[int, float]] = {}
    columns = (parts.group.tolist(), parts.points.tolist(), parts.seen_at.tolist())
    for group, points, seen_at in zip(*columns, strict=True):
        source = witnesses.of(session_of_key(group))
        known, last = seen.get(source, (0, 0.0))
        seen[source] = known + points, max(last, seen_at)
    name = f"vehicle {merged.vehicles.group[row]}"
    return [
        Evidence(
            seen_at,
            VEHICLE_LOG_ODDS * parked * points / (points + TYPICAL_POINTS),
            f"{name} of {points} points, {share:.0%} of it here",
            source,
        )
        for source, (points, seen_at) in sorted(seen.items())
    ]


def _of_ground(windows: list[WindowVotes], core: NDArray[np.bool_], ground: bool) -> list[Evidence]:
    """One piece of evidence per pass."""
    if not windows or not core.any():
        return []
    windows = sorted(windows, key=lambda w: (w.session, w.end, w.sequence))
    starts = _pass_starts(windows)
    free, obstacle = (
        np.concatenate(v).reshape(-1, len(core)) for v in zip(*((w.free, w.obstacle) for w in windows), strict=True)
    )
    shares = shares_of_passes(free, obstacle, core, np.array(starts)).tolist()
    found = []
    for first, end, (free_share, obstacle_share) in zip(starts, [*starts[1:], len(windows)], shares, strict=True):
        sigma_m = max(window.sigma_m for window in windows[first:end])
        log_odds = _log_odds(free_share, obstacle_share, ground) / (1.0 + (sigma_m / POSITION_SIGMA_M) ** 2)
        reason = f"ground {free_share:.0%} free, {obstacle_share:.0%} obstacle"
        found.append(Evidence(windows[end - 1].end, log_odds, reason, windows[first].source))
    return found


def _log_odds(free_share: float, obstacle_share: float, ground: bool) -> float:
    """Of a pass that saw these shares of a spot free and with obstacles, its place certain."""
    seen = free_share + obstacle_share
    if not ground:
        return max(-seen, -MOST_LOG_ODDS)
    lean = obstacle_share / max(seen, 1e-9) - OBSTACLE_RATIO_EVEN
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
