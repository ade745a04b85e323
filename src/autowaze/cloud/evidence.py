"""What vehicles and ground say of a spot, as log-odds of being occupied.

The ground of one pass is one observation, however many windows and frames it spans: its errors (a shift of the car's
position, a wrong ground plane) are common to all of them.
"""

from __future__ import annotations

from itertools import groupby

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
MARGIN_M = 0.35
"""Along its edges a spot is not looked at: that far a car may be off, and its neighbours lean over."""
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
        items.extend(_of_ground(spot, index, votes.windows(spot), ground))
    return found


def _of_vehicles(vehicles: VehicleBoxes, index: SpotIndex) -> list[tuple[int, int, float]]:
    """(vehicle, spot, share of the vehicle in it) of each vehicle and the spot that it overlaps most."""
    row, spot = index.overlapping(vehicles.polygons)
    common = shapely.area(shapely.intersection(vehicles.polygons[row], index.polygons[spot]))
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


def _of_ground(spot: int, index: SpotIndex, windows: list[WindowVotes], ground: bool) -> list[Evidence]:
    """One piece of evidence per pass."""
    core = _core(spot, index)
    return [_from_pass(one_pass, core, ground) for one_pass in _passes(windows)]


def _core(spot: int, index: SpotIndex) -> NDArray[np.bool_]:
    """Which cells (C,) of the spot's raster lie off its edges."""
    offset = index.raster(spot)[1]
    along = np.array([np.sin(index.heading[spot]), np.cos(index.heading[spot])])
    aside = np.abs(offset @ np.array([along[1], -along[0]]))
    inside = np.abs(offset @ along) <= index.length[spot] / 2 - MARGIN_M
    return np.asarray(inside & (aside <= index.width[spot] / 2 - MARGIN_M))


def _passes(windows: list[WindowVotes]) -> list[list[WindowVotes]]:
    """Windows split into passes: of one session, with no long gap."""
    passes: list[list[WindowVotes]] = []
    by_session = sorted(windows, key=lambda w: (w.session, w.end, w.sequence))
    for _, of_session in groupby(by_session, key=lambda w: w.session):
        one_pass: list[WindowVotes] = []
        for window in of_session:
            if one_pass and window.end - one_pass[-1].end > PASS_GAP_S:
                passes.append(one_pass)
                one_pass = []
            one_pass.append(window)
        passes.append(one_pass)
    return passes


def _from_pass(windows: list[WindowVotes], core: NDArray[np.bool_], ground: bool) -> Evidence:
    free = np.sum([window.free[core] for window in windows], axis=0, dtype=np.int64)
    obstacle = np.sum([window.obstacle[core] for window in windows], axis=0, dtype=np.int64)
    obstacle_share = float(np.mean((obstacle > 0) & (obstacle >= free)))
    free_share = float(np.mean(free > obstacle))
    seen = obstacle_share + free_share
    log_odds = -seen
    if ground:
        log_odds = LOG_ODDS_PER_OBSTACLE_SHARE * (obstacle_share - OBSTACLE_SHARE_EVEN * seen)
        log_odds -= LOG_ODDS_PER_FREE_SHARE * max(free_share - FREE_SHARE_EVEN, 0.0)
    sigma = float(np.mean([window.sigma_m for window in windows]))
    trust = 1.0 / (1.0 + (sigma / POSITION_SIGMA_M) ** 2)
    log_odds = trust * min(max(log_odds, -MOST_LOG_ODDS), MOST_LOG_ODDS)
    return Evidence(windows[-1].end, log_odds, f"ground {free_share:.0%} free, {obstacle_share:.0%} obstacle")
