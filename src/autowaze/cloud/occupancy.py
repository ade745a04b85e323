"""Vehicle boxes and spots -> occupied spots: two passes with an R-tree (thesis, sec. 3.3.5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

SIGNIFICANT_OVERLAP = 0.3
"""Share of a spot that a box covers for the second pass to cull it."""


@dataclass(frozen=True)
class TwoPassOccupancy:
    """Which box took which spot.

    Attributes:
        first: (S,) int64, row of the box that was associated with the spot in the first pass, -1 for none.
        second: (S,) int64, row of the box that culled it in the second pass, -1 for none.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """(S,) whether either pass took the spot."""
        return (self.first >= 0) | (self.second >= 0)


def match_two_pass(
    spots: NDArray[np.object_], boxes: NDArray[np.object_], second_pass: bool = True
) -> TwoPassOccupancy:
    """Associate boxes (B,) with spots (S,), both shapely polygons in map metres.

    First pass, an R-tree of the spots: each box takes the spot that it overlaps most; of several boxes the one with
    the highest overlap is associated with it. Second pass, an R-tree of the boxes: each spot that is still vacant is
    culled if some box covers a significant share of it, for the true spot of that box may be this one (SLAM drift).
    """
    box, spot = shapely.STRtree(spots).query(boxes, predicate="intersects")
    overlap = shapely.area(shapely.intersection(boxes[box], spots[spot]))
    best_spot = _best(box, spot, overlap, len(boxes))
    takes = (best_spot[box] == spot) & (overlap > 0)
    first = _best(spot[takes], box[takes], overlap[takes], len(spots))
    second = np.full(len(spots), -1, np.int64)
    if second_pass:
        vacant = np.flatnonzero(first < 0)
        row, box = shapely.STRtree(boxes).query(spots[vacant], predicate="intersects")
        share = shapely.area(shapely.intersection(spots[vacant[row]], boxes[box])) / shapely.area(spots[vacant[row]])
        cull = share >= SIGNIFICANT_OVERLAP
        second[vacant] = _best(row[cull], box[cull], share[cull], len(vacant))
    return TwoPassOccupancy(first, second)


def vacant_rectangles(spots: NDArray[np.object_]) -> list[dict[str, float]]:
    """The thesis's output (sec. 3.3.6) for spots (V,): lower left corner, width (east) and height (north) in metres.

    For a spot that does not lie along the axes it is the rectangle around it.
    """
    return rectangles_within(shapely.bounds(spots).reshape(-1, 4))


def rectangles_within(bounds: NDArray[np.float64]) -> list[dict[str, float]]:
    """The same from bounds (V, 4) of the spots."""
    return [
        {"x": x0, "y": y0, "width": round(x1 - x0, 3), "height": round(y1 - y0, 3)}
        for x0, y0, x1, y1 in np.round(bounds, 3).tolist()
    ]


def _best(
    owner: NDArray[np.int64], candidate: NDArray[np.int64], score: NDArray[np.float64], owners: int
) -> NDArray[np.int64]:
    """Candidate (owners,) with the highest score of each owner, the first of equals; -1 where there is none."""
    best = np.full(owners, -1, np.int64)
    order = np.lexsort((candidate, -score, owner))[::-1]  # numpy keeps the last one written
    best[owner[order]] = candidate[order]
    return best
