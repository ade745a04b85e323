"""What a car saw of the ground: a sparse grid of votes for free and for obstacle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.world.columns import Columns

CELL_M = 0.25
"""Edge of a ground cell in metres; part of the wire format."""
_CODE_OFFSET = 1 << 31


@dataclass
class GroundCells(Columns):
    """Cells of the map's ground plane that were seen, N rows; a cell without a row is unseen.

    Attributes:
        ix, iy: (N,) int32, floor(x / CELL_M), floor(y / CELL_M) of the cell in the map frame.
        free: (N,) uint16, frames that saw ground there.
        obstacle: (N,) uint16, frames that saw something standing there.
    """

    ix: NDArray[np.int32]
    iy: NDArray[np.int32]
    free: NDArray[np.uint16]
    obstacle: NDArray[np.uint16]

    @classmethod
    def empty(cls) -> GroundCells:
        """Nothing seen."""
        return cls(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.uint16), np.zeros(0, np.uint16))

    @property
    def centre(self) -> NDArray[np.float64]:
        """Centres (N, 2) in map metres."""
        return np.asarray((np.stack([self.ix, self.iy], axis=1) + 0.5) * CELL_M, dtype=np.float64)

    def blocks(self, bits: int) -> NDArray[np.int64]:
        """Squares x, y (B, 2) of 2^bits by 2^bits cells that hold cells, each once, sorted by y, then x."""
        x = (self.ix >> bits).astype(np.int64) + _CODE_OFFSET
        code = ((self.iy >> bits).astype(np.int64) << 32) | x
        if len(code):  # cells come sorted, so most lie in the block of the one before
            code = np.unique(code[np.append(True, code[1:] != code[:-1])])
        return np.stack([(code & 0xFFFF_FFFF) - _CODE_OFFSET, code >> 32], axis=1)
