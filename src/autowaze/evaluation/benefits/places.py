"""Places to look for parking in, drawn by seed: the simulator's streets, blocks and car parks, and districts.

A district is a grid of the simulator's blocks: bays along every street between the crossings, streets that run on.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from itertools import pairwise, product

import numpy as np
import shapely
from numpy.typing import NDArray

from autowaze.evaluation.benefits.lanes import ParkingLanes
from autowaze.simulator.curve import Curve
from autowaze.simulator.description import StreetDescription
from autowaze.simulator.plan.roads import Road, make_bay, pitch
from autowaze.simulator.plan.street_plan import plan_street
from autowaze.simulator.surroundings import lane_lines

_CLEAR_OF_CROSSING_M = 12.5  # as the simulator's plans keep it
_RUN_ON_M = 48.0
_BLOCKS = 3


class PlaceKind(StrEnum):
    """Where drivers look for a spot."""

    STREET = "street"
    """One street between two crossings, straight or curved."""
    BLOCK = "block"
    """Four streets round a block."""
    DISTRICT = "district"
    """Three by three blocks."""
    LOT = "lot"
    """Two aisles with bays on both sides, joined at their ends."""


def draw_place(kind: PlaceKind, rng: np.random.Generator) -> ParkingLanes:
    """A place of this kind; cars come in where lanes end, or at a corner where none does."""
    return _DRAWN[kind](rng)


def _street(rng: np.random.Generator) -> ParkingLanes:
    curved = bool(rng.integers(2))
    turn = float(rng.uniform(-40.0, 40.0)) if curved else 0.0
    layout = "curved" if curved else "straight"
    return _planned(rng, layout=layout, turn_deg=turn, length_m=float(rng.uniform(80.0, 200.0)))


def _block(rng: np.random.Generator) -> ParkingLanes:
    return _planned(
        rng, layout="block", length_m=float(rng.uniform(80.0, 180.0)), depth_m=float(rng.uniform(60.0, 120.0))
    )


def _lot(rng: np.random.Generator) -> ParkingLanes:
    return _planned(rng, layout="lot", length_m=float(rng.uniform(50.0, 120.0)))


def _planned(rng: np.random.Generator, **shape: object) -> ParkingLanes:
    description = StreetDescription.model_validate({"seed": int(rng.integers(1 << 31)), **shape})
    plan = plan_street(description)
    lines = lane_lines(plan, description.layout == "lot")
    return ParkingLanes(lines, [bay.polygon for bay in plan.bays], _entrances(lines))


def _district(rng: np.random.Generator) -> ParkingLanes:
    across, up = (float(v) for v in rng.uniform((80.0, 60.0), (160.0, 110.0)))
    x, y = across * np.arange(_BLOCKS + 1), up * np.arange(_BLOCKS + 1)
    run_on = np.array([-_RUN_ON_M, _RUN_ON_M])
    lines, bays = [], []
    for fixed, crossings, upright in (*((v, y, True) for v in x), *((v, x, False) for v in y)):
        stops = np.concatenate([crossings[:1] + run_on[0], crossings, crossings[-1:] + run_on[1]])
        column = np.full(len(stops), fixed)
        points = np.column_stack([column, stops] if upright else [stops, column])
        lines.append(shapely.LineString(points))
        bays += _bays_between_crossings(Curve(points))
    return ParkingLanes(lines, bays, _entrances(lines))


def _bays_between_crossings(centre: Curve) -> list[shapely.Polygon]:
    """Parallel bays on both sides."""
    road, step = Road(centre, (0.0, 0.0), (0.0, centre.length)), pitch("parallel")
    crossings = centre.s[1:-1]
    bays = []
    for (start, end), side in product(pairwise(crossings), (1, -1)):
        count = int((end - start - 2 * _CLEAR_OF_CROSSING_M) / step)
        first = start + (end - start - count * step) / 2 + step / 2
        bays += [make_bay(road, 0, "", 0, "parallel", first + n * step, side, step).polygon for n in range(count)]
    return bays


def _entrances(lines: list[shapely.LineString]) -> NDArray[np.float64]:
    """Ends of lanes (E, 2) that lie on no other lane; all ends where there are none."""
    ends = shapely.get_coordinates([shapely.get_point(line, which) for line in lines for which in (0, -1)])
    touching = shapely.STRtree(lines).query(shapely.points(ends), predicate="dwithin", distance=0.1)[0]
    alone = np.bincount(touching, minlength=len(ends)) == 1
    return ends[alone] if alone.any() else ends[np.unique(ends.round(3), axis=0, return_index=True)[1]]


_DRAWN: dict[PlaceKind, Callable[[np.random.Generator], ParkingLanes]] = {
    PlaceKind.STREET: _street,
    PlaceKind.BLOCK: _block,
    PlaceKind.DISTRICT: _district,
    PlaceKind.LOT: _lot,
}
