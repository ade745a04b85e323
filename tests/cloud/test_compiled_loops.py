"""Compiled loops against the same in a few lines of numpy."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from autowaze.cloud.cell_kernels import blocks_of_cells, cells_ascend, shares_of_passes, votes_of_codes
from autowaze.cloud.path_distance import all_within
from autowaze.cloud.spots import cell_codes
from autowaze.world.ground import GroundCells


def _cells(rng: np.random.Generator, count: int) -> GroundCells:
    codes = np.unique(cell_codes(rng.integers(-40, 60, count), rng.integers(-70, 30, count)))
    iy = (codes + (1 << 31)) >> 32
    votes = rng.integers(0, 400, (2, len(codes)))
    return GroundCells((codes - (iy << 32)).astype(np.int32), iy.astype(np.int32), *votes.astype(np.uint16))


@pytest.mark.parametrize("seed", range(5))
def test_blocks_are_those_that_the_cells_lie_in(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = _cells(rng, 800)
    shuffled = cells[rng.permutation(len(cells))]
    assert cells_ascend(cells.ix, cells.iy)
    assert not cells_ascend(shuffled.ix, shuffled.iy)
    for bits in (4, 5):
        expected = np.unique(np.stack([cells.iy >> bits, cells.ix >> bits], axis=1), axis=0)[:, ::-1]
        np.testing.assert_array_equal(blocks_of_cells(cells.ix, cells.iy, bits), expected)
        np.testing.assert_array_equal(blocks_of_cells(shuffled.ix, shuffled.iy, bits), expected)
    twice = cells[np.repeat(np.arange(3), 2)]
    assert not cells_ascend(twice.ix, twice.iy)


@pytest.mark.parametrize("seed", range(5))
def test_votes_are_found_by_code(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = _cells(rng, 1500)
    runs = [np.sort(cell_codes(rng.integers(-50, 70, 90), rng.integers(-75, 35, 90))) for _ in range(6)]
    codes = np.concatenate([*runs, rng.permutation(np.concatenate(runs))])
    votes = dict(
        zip(cell_codes(cells.ix, cells.iy).tolist(), zip(cells.free, cells.obstacle, strict=True), strict=True)
    )
    expected = np.array([votes.get(code, (0, 0)) for code in codes.tolist()]).clip(max=255).T
    np.testing.assert_array_equal(votes_of_codes(cells.ix, cells.iy, cells.free, cells.obstacle, codes), expected)


@pytest.mark.parametrize("seed", range(5))
def test_shares_of_passes_are_means_over_the_core(seed: int) -> None:
    rng = np.random.default_rng(seed)
    free, obstacle = rng.integers(0, 4, (2, 7, 50)).astype(np.uint8)
    core = rng.random(50) < 0.6
    starts = np.array([0, 1, 4])
    sees_free, sees_obstacle = (np.add.reduceat(v.astype(int)[:, core], starts) for v in (free, obstacle))
    expected = np.stack(
        [
            (sees_free > sees_obstacle).mean(axis=1),
            ((sees_obstacle > 0) & (sees_obstacle >= sees_free)).mean(axis=1),
        ],
        axis=1,
    )
    np.testing.assert_array_equal(shares_of_passes(free, obstacle, core, starts), expected)


@pytest.mark.parametrize("seed", range(20))
def test_points_within_reach_of_a_path_are_those_within_its_buffer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(0, 8, (rng.integers(1, 7), 2)), axis=0)
    points = rng.normal(0, 30, (rng.integers(0, 6), 2))
    line = shapely.LineString(path) if len(path) > 1 else shapely.Point(path[0])
    expected = bool((shapely.distance(shapely.points(points), line) <= 35.0).all())
    assert all_within(points, path, 35.0) == expected
