"""What it costs to draw and erase a spot while the service runs, in a city of 100,000 spots."""

from __future__ import annotations

import time

import numpy as np
import shapely

from autowaze.cloud.api.spot_sheet import SpotSheet
from autowaze.cloud.service import CloudService
from autowaze.cloud.spot_edits import SpotEdit, check_edit, drawing, feature_of_spot
from autowaze.world.georeference import Georeference
from autowaze.world.parking import ParkingMap, ParkingSpot
from autowaze.world.vehicles import box_corners

ORIGIN = Georeference(40.0, -73.0)
ROW, ROWS, STREETS = 20, 50, 100
EDITS = 20


def city() -> ParkingMap:
    """Rows of 20 parallel spots, with gaps between them."""
    row, number = np.divmod(np.arange(ROW * ROWS * STREETS), ROW)
    centre = np.column_stack([(row % ROWS) * 150.0 + number * 6.0, (row // ROWS) * 60.0])
    ones = np.ones(len(centre))
    rings = box_corners(centre, 5.7 * ones, 2.1 * ones, np.pi / 2 * ones)
    spots = (
        ParkingSpot(f"{r}-{n}", ring, "parallel")
        for r, n, ring in zip(row, number, shapely.polygons(rings), strict=True)
    )
    return ParkingMap(tuple(spots), ORIGIN)


def run() -> None:
    """Print CPU milliseconds per edit, median and slowest."""
    parking_map = city()
    sheet, service = SpotSheet(parking_map), CloudService(parking_map)
    rng = np.random.default_rng(0)
    beside: list[float] = []
    within: list[float] = []
    for n, row in enumerate(rng.choice(len(parking_map), EDITS, replace=False).tolist()):
        spot = parking_map.spots[row]
        moved = ParkingSpot(spot.id, shapely.affinity.translate(spot.polygon, 0.2, 0.1), spot.kind)
        edit = SpotEdit(spot.id, None) if n % 2 else drawing(spot.id, feature_of_spot(moved, ORIGIN))
        drawn = edit.spot(ORIGIN)
        started = time.thread_time()
        sheet = sheet.without_spot(edit.spot_id) if drawn is None else sheet.with_spot(drawn)
        done = time.thread_time()
        check_edit(edit, service.spots)
        service.edit(edit)
        service.spots.tree.query(shapely.Point(0.0, 0.0))  # which the next diff needs
        beside.append(1000 * (done - started))
        within.append(1000 * (time.thread_time() - done))
    print(f"{len(parking_map)} spots, {EDITS} edits, CPU ms per edit, median / slowest")
    for name, figures in (("beside the thread that takes diffs", beside), ("in that thread", within)):
        print(f"{name:36} {np.median(figures):6.0f} {max(figures):6.0f}")
