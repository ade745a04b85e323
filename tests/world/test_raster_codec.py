"""Grids of classes as bytes: nothing is lost, patches are small, strangers' bytes cost no more than they may."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autowaze.world.errors import WireError
from autowaze.world.raster_codec import BLOCK, MAX_SQUARES, pack_classes, unpack_classes


def patches(seed: int, rows: int, columns: int, size_cells: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    field = cv2.GaussianBlur(rng.random((rows * BLOCK, columns * BLOCK)).astype(np.float32), (0, 0), size_cells)
    return np.digitize(field, np.quantile(field, [0.6, 0.85])).astype(np.uint8)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 1 << 32), st.integers(1, 9), st.integers(1, 9), st.floats(0.3, 5.0))
def test_every_grid_comes_back(seed: int, rows: int, columns: int, size_cells: float) -> None:
    grid = patches(seed, rows, columns, size_cells)
    assert np.array_equal(unpack_classes(pack_classes(grid), *grid.shape, "grid"), grid)


@pytest.mark.parametrize("value", [0, 1, 2])
def test_a_uniform_grid_costs_next_to_nothing(value: int) -> None:
    grid = np.full((10 * BLOCK, 10 * BLOCK), value, np.uint8)
    packed = pack_classes(grid)
    assert len(packed) < 60
    assert np.array_equal(unpack_classes(packed, *grid.shape, "grid"), grid)


def test_noise_of_the_worst_kind_comes_back() -> None:
    grid = np.random.default_rng(1).integers(0, 3, (8 * BLOCK, 8 * BLOCK), dtype=np.uint8)
    assert np.array_equal(unpack_classes(pack_classes(grid), *grid.shape, "grid"), grid)


def test_patches_take_a_quarter_of_their_bits() -> None:
    grid = patches(3, 8, 8, 4.0)
    assert len(pack_classes(grid)) < grid.size * np.log2(3) / 8 / 4


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=400))
def test_whatever_the_bytes_the_grid_is_one(data: bytes) -> None:
    assert unpack_classes(data, 4 * BLOCK, 4 * BLOCK, "grid").max() <= 2


@pytest.mark.parametrize("shape", [(BLOCK - 1, BLOCK), (BLOCK, BLOCK * (MAX_SQUARES + 1))])
def test_a_grid_of_no_size_is_refused(shape: tuple[int, int]) -> None:
    with pytest.raises(WireError, match="no grid"):
        unpack_classes(b"", *shape, "grid")
