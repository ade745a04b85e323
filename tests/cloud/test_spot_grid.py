"""Where spots lie, compiled, against shapely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely.affinity import translate
from street import GEOREFERENCE, Street

from autowaze.cloud.cell_kernels import blocks_of_cells
from autowaze.cloud.spot_grid import cells_in_reach
from autowaze.cloud.spots import MARGIN_M, SpotIndex, cell_codes, raster_of
from autowaze.world.ground import CELL_M
from autowaze.world.parking import ParkingMap, ParkingSpot
from autowaze.world.vehicles import box_corners

BENT = shapely.Polygon([(0, 0), (9, 0), (9, 3), (4, 3), (4, 8), (0, 8)])


@pytest.fixture(scope="module")
def spots() -> SpotIndex:
    """Streets in several cells of the grid, west and south of the origin too, and a spot around a corner."""
    copies = [
        replace(spot, id=f"{east} {spot.id}", polygon=translate(spot.polygon, east, -0.6 * east))
        for east in (-150.0, 0.0, 70.0)
        for spot in Street().parking_map.spots
    ]
    return SpotIndex(ParkingMap((*copies, ParkingSpot("bent", translate(BENT, -20.3, 11.7))), GEOREFERENCE))


def _places(spots: SpotIndex, rng: np.random.Generator, count: int) -> np.ndarray:
    return spots.centre[rng.integers(0, len(spots), count)] + rng.normal(0, 4.0, (count, 2))


@pytest.mark.parametrize("seed", range(5))
def test_areas_in_common_with_boxes_are_those_of_shapely(spots: SpotIndex, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, heading = rng.uniform(1.5, 9.0, (2, 60)), rng.uniform(-4.0, 4.0, 60)
    corners = box_corners(_places(spots, rng, 60), *size, heading)
    boxes = shapely.polygons(corners)
    row, spot = spots.overlapping(boxes)
    for ring in (corners, corners[:, ::-1]):
        found_row, found_spot, area = spots.grid.overlaps(ring)
        np.testing.assert_array_equal(found_row, row)
        np.testing.assert_array_equal(found_spot, spot)
        np.testing.assert_allclose(
            area, shapely.area(shapely.intersection(boxes[row], spots.polygons[spot])), atol=1e-9
        )
    assert (spots.ids.index("bent") == spot).any()


@pytest.mark.parametrize("seed", range(5))
def test_nearest_spots_are_those_of_shapely(spots: SpotIndex, seed: int) -> None:
    points = _places(spots, np.random.default_rng(seed), 200)
    distance = shapely.distance(shapely.points(points)[:, None], spots.polygons)
    expected = np.where(distance.min(axis=1) <= 3.0, distance.argmin(axis=1), -1)
    np.testing.assert_array_equal(spots.grid.nearest(points, 3.0), expected)
    assert (expected < 0).any()


def test_spots_around_cells_touch_their_blocks(spots: SpotIndex) -> None:
    rng = np.random.default_rng(0)
    for _ in range(30):
        cells = np.floor(_places(spots, rng, 1) / CELL_M + rng.integers(-90, 90, (50, 2))).astype(np.int32)
        low = blocks_of_cells(*cells.T, 6) * 16.0
        blocks = shapely.box(*low.T, *(low + 16.0).T)
        expected = np.flatnonzero(shapely.intersects(shapely.box(*spots.bounds.T)[:, None], blocks).any(axis=1))
        np.testing.assert_array_equal(spots.grid.around_cells(*cells.T), expected)


def test_cells_of_a_spot_are_those_whose_centres_it_holds(spots: SpotIndex) -> None:
    for row in (0, 20, len(spots) - 1):
        polygon, raster = spots.polygons[row], raster_of(spots.polygons[row])
        low, high = (np.floor(np.array(part) / CELL_M).astype(int) for part in np.split(spots.bounds[row], 2))
        iy, ix = (axis.ravel() for axis in np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1])
        x, y = (ix + 0.5) * CELL_M, (iy + 0.5) * CELL_M
        inside = shapely.contains_xy(polygon, x, y)
        np.testing.assert_array_equal(raster.codes, cell_codes(ix, iy)[inside])
        off_edge = shapely.distance(polygon.exterior, shapely.points(x, y)) > MARGIN_M
        np.testing.assert_array_equal(raster.core, off_edge[inside])
        box = box_corners(spots.centre[[row]] + [1.0, 2.0], np.array([4.4]), np.array([1.8]), np.array([0.7]))[0]
        away = shapely.distance(shapely.Polygon(box), shapely.points(x, y))
        np.testing.assert_array_equal(cells_in_reach(raster.codes, box, 0.25), (away <= 0.25)[inside])


def test_a_city_without_spots_has_nothing_near() -> None:
    none = SpotIndex(ParkingMap((), GEOREFERENCE)).grid
    assert none.nearest(np.zeros((2, 2)), 10.0).tolist() == [-1, -1]
    assert len(none.around_cells(np.zeros(1, np.int32), np.zeros(1, np.int32))) == 0
    assert len(none.overlaps(np.ones((1, 4, 2)))[0]) == 0
