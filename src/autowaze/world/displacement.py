"""A diff moved, place by place, to where its car is known to have been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from autowaze.world.ground import CELL_M, GroundCells
from autowaze.world.map_diff import SemanticMapDiff


def displaced(diff: SemanticMapDiff, path: NDArray[np.float64], shifts: NDArray[np.float64]) -> SemanticMapDiff:
    """The diff with each place moved as the point of the path (F, 2) is that comes nearest to it, by shifts (F, 2).

    Ground moves by whole cells.
    """
    near = cKDTree(path)

    def shift(places: NDArray[np.floating]) -> NDArray[np.float64]:
        return np.asarray(shifts[near.query(places[:, :2])[1]]) if len(places) else np.zeros((0, 2))

    new, ground, traffic, trajectory = diff.new, diff.ground, diff.traffic, diff.trajectory
    moving = (traffic.position + shift(traffic.position)).astype(np.float32)
    return replace(
        diff,
        new=replace(new, position=_plus(new.position, shift(new.position))),
        ground=_moved(ground, np.rint(shift(ground.centre) / CELL_M).astype(np.int32)),
        traffic=replace(traffic, position=moving),
        trajectory=replace(trajectory, position=_plus(trajectory.position, shift(trajectory.position))),
    )


def _plus(position: NDArray[np.float64], shift: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (N, 3) moved by horizontal shifts (N, 2)."""
    return np.column_stack([position[:, :2] + shift, position[:, 2:]])


def _moved(ground: GroundCells, by: NDArray[np.int32]) -> GroundCells:
    """Cells moved by whole ones (N, 2); of two that meet the first stays."""
    ix, iy = ground.ix + by[:, 0], ground.iy + by[:, 1]
    _, first = np.unique(ix.astype(np.int64) << 32 | iy.astype(np.int64) & 0xFFFF_FFFF, return_index=True)
    return GroundCells(ix, iy, ground.free, ground.obstacle)[np.sort(first)]
