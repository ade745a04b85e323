"""What vehicles and ground say of a spot, as log-odds of being occupied.

The ground of one pass is one observation, however many windows and frames it spans: its errors (a shift of the car's
position, a wrong ground plane) are common to all of them.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.cloud.belief import Evidence
from autowaze.cloud.ground_votes import GroundVotes, WindowVotes
from autowaze.cloud.merging import vehicles_at
from autowaze.cloud.scene import VehicleScene
from autowaze.cloud.spots import SpotIndex
from autowaze.world.vehicles import VehicleBoxes

PASS_GAP_S = 30.0
"""Windows of a session that are closer in time belong to one pass."""
MOST_LOG_ODDS = 5.0

# A spike on real drives: occupied spots had >= 0.19 of their cells obstacle, vacant ones <= 0.10 and >= 0.90 free.
OBSTACLE_SHARE_EVEN = 0.13
LOG_ODDS_PER_OBSTACLE_SHARE = 25.0
FREE_SHARE_EVEN = 0.4
LOG_ODDS_PER_FREE_SHARE = 6.0

PARKED_OVERLAP = 0.5
"""Share of a vehicle that lies in a spot from which on it is parked there."""
GRAZING_OVERLAP = 0.25
VEHICLE_LOG_ODDS = 4.0
TYPICAL_POINTS = 10.0
POSITION_SIGMA_M = 0.7
"""A car that knows its place no better than this is believed half."""


def evidence_of(
    spots: NDArray[np.int64], index: SpotIndex, scene: VehicleScene, votes: GroundVotes, ground: bool = True
) -> list[list[Evidence]]:
    """All evidence on each of these spots (T,), in no order of time.

    Vehicles count for the spot that they overlap most, if enough of them lies in it: one that stands in the lane
    is not parked. Without `ground` its windows still tell where a car looked and found no vehicle.
    """
    found: list[list[Evidence]] = [[] for _ in range(len(spots))]
    vehicles = vehicles_at(index.polygons[spots], scene)
    for row, spot, item in _of_vehicles(vehicles, index):
        position = int(np.searchsorted(spots, spot))
        if position < len(spots) and spots[position] == spot:
            found[position].append(_from_vehicle(vehicles, row, item))
    for spot, items in zip(spots.tolist(), found, strict=True):
        items.extend(_of_ground(votes.windows(spot), index.raster(spot).core, ground))
    return found


def _of_vehicles(vehicles: VehicleBoxes, index: SpotIndex) -> list[tuple[int, int, float]]:
    """(vehicle, spot, share of the vehicle in it) of each vehicle and the spot that it overlaps most."""
    footprints = vehicles.polygons
    row, spot = index.overlapping(footprints)
    common = shapely.area(shapely.intersection(footprints[row], index.polygons[spot]))
    share = common / (vehicles.length * vehicles.width)[row]
    order = np.lexsort((spot, -share, row))
    best = order[np.unique(row[order], return_index=True)[1]]
    return [(int(row[i]), int(spot[i]), float(share[i])) for i in best]


def _from_vehicle(vehicles: VehicleBoxes, row: int, share: float) -> Evidence:
    points = int(vehicles.points[row])
    parked = np.clip((share - GRAZING_OVERLAP) / (PARKED_OVERLAP - GRAZING_OVERLAP), 0.0, 1.0)
    log_odds = VEHICLE_LOG_ODDS * float(parked) * points / (points + TYPICAL_POINTS)
    reason = f"vehicle {vehicles.group[row]} of {points} points, {share:.0%} of it here"
    return Evidence(float(vehicles.seen_at[row]), log_odds, reason)


def _of_ground(windows: list[WindowVotes], core: NDArray[np.bool_], ground: bool) -> list[Evidence]:
    """One piece of evidence per pass."""
    if not windows:
        return []
    windows = sorted(windows, key=lambda w: (w.session, w.end, w.sequence))
    starts = _pass_starts(windows)
    free = np.add.reduceat(np.array([w.free for w in windows], np.int64)[:, core], starts)
    obstacle = np.add.reduceat(np.array([w.obstacle for w in windows], np.int64)[:, core], starts)
    sigma = np.maximum.reduceat([w.sigma_m for w in windows], starts)
    free_share = np.mean(free > obstacle, axis=1)
    obstacle_share = np.mean((obstacle > 0) & (obstacle >= free), axis=1)
    seen = free_share + obstacle_share
    log_odds = -seen
    if ground:
        log_odds = LOG_ODDS_PER_OBSTACLE_SHARE * (obstacle_share - OBSTACLE_SHARE_EVEN * seen)
        log_odds -= LOG_ODDS_PER_FREE_SHARE * np.maximum(free_share - FREE_SHARE_EVEN, 0.0)
    log_odds = np.clip(log_odds, -MOST_LOG_ODDS, MOST_LOG_ODDS) / (1.0 + (sigma / POSITION_SIGMA_M) ** 2)
    ends = (windows[last - 1].end for last in [*starts[1:], len(windows)])
    columns = (log_odds.tolist(), free_share.tolist(), obstacle_share.tolist())
    return [
        Evidence(end, odds, f"ground {free_part:.0%} free, {obstacle_part:.0%} obstacle")
        for end, odds, free_part, obstacle_part in zip(ends, *columns, strict=True)
    ]


def _pass_starts(windows: list[WindowVotes]) -> list[int]:
    """First window of each pass, windows sorted by session and time: a pass is of one session, with no long gap."""
    starts = [0]
    for row in range(1, len(windows)):
        before, window = windows[row - 1], windows[row]
        if window.session != before.session or window.end - before.end > PASS_GAP_S:
            starts.append(row)
    return starts
