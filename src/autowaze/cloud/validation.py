"""What a diff must fulfil, beyond being well formed, before it may touch the map.

Everything that a car sends is hostile until shown otherwise. Each check needs only the diff and the georeference of
the service, so whether a diff is taken does not depend on what came before it.
"""

from __future__ import annotations

import math

import numpy as np

from autowaze.cloud.diff_kernels import (
    all_between,
    ascends,
    extent_of_cells,
    extent_of_places,
    numbered_from,
    of_session,
)
from autowaze.cloud.spots import cell_codes
from autowaze.world.errors import WireError
from autowaze.world.georeference import Georeference
from autowaze.world.ground import CELL_M
from autowaze.world.identity import MAX_SEQUENCE, MAX_SESSION, ROW_BITS, SEQUENCE_BITS
from autowaze.world.map_diff import SemanticMapDiff

MAX_EXTENT_M = 100_000.0
"""Farther from the map's origin than a metropolitan area is wide."""
MAX_WINDOW_M = 2_000.0
"""What one window may span: a car at 30 m/s for a minute, and its sight."""
MAX_GROUND_CELLS = 1 << 17
MAX_REMOVED = 1 << 16


class RefusedDiffError(WireError):
    """A well-formed diff that says something impossible; the service goes on as if it had never come.

    Attributes:
        reason: of what kind, one word for counters and the audit log.
    """

    def __init__(self, message: str, reason: str = "impossible") -> None:
        super().__init__(message)
        self.reason = reason


def check_diff(diff: SemanticMapDiff, georeference: Georeference | None) -> None:
    """Refuse a diff that cannot be true.

    Raises:
        RefusedDiffError: naming the diff, what is wrong and the limit.
    """
    try:
        _check_header(diff, georeference)
        _check_features(diff)
        _check_ground(diff)
        _check_instances(diff)
    except RefusedDiffError as error:
        raise RefusedDiffError(f"diff {diff.session}/{diff.sequence} refused: {error}") from error


def _check_header(diff: SemanticMapDiff, georeference: Georeference | None) -> None:
    _require(0 <= diff.session < MAX_SESSION and 0 <= diff.sequence < MAX_SEQUENCE, "session or sequence out of range")
    _require(bool(np.isfinite([diff.start, diff.end]).all()) and 0 <= diff.start <= diff.end, "not a time window")
    mismatch = diff.georeference is not None and georeference is not None and diff.georeference != georeference
    _require(not mismatch, "its georeference is not the one of this service's map; fetch the map again")


def _check_features(diff: SemanticMapDiff) -> None:
    new = diff.new
    _require(len(diff.removed) <= MAX_REMOVED, f"more than {MAX_REMOVED} removed features")
    first_id = np.uint64((diff.session << SEQUENCE_BITS | diff.sequence) << ROW_BITS)
    _require(numbered_from(new.id, first_id), "new features carry ids of another diff")
    _require(of_session(new.instance_key, np.uint64(diff.session)), "instances of another session")
    _require(ascends(diff.removed), "removed ids are not sorted")
    if len(new) == 0 and len(diff.trajectory) == 0:
        return
    x0, x1, y0, y1 = extent_of_places(new.position, diff.trajectory.position)
    _require(not math.isnan(x0), "a position is not a number")
    farthest_m = max(-x0, x1, -y0, y1)
    _require(farthest_m <= MAX_EXTENT_M, f"a position is more than {MAX_EXTENT_M:.0f} m away")
    _require(max(x1 - x0, y1 - y0) <= MAX_WINDOW_M, f"one window spans more than {MAX_WINDOW_M:.0f} m")


def _check_ground(diff: SemanticMapDiff) -> None:
    ground = diff.ground
    _require(len(ground) <= MAX_GROUND_CELLS, f"more than {MAX_GROUND_CELLS} ground cells")
    if len(ground) == 0:
        return
    x0, x1, y0, y1, ascend = extent_of_cells(ground.ix, ground.iy)
    for low, high in ((x0, x1), (y0, y1)):
        _require(max(-low, high) * CELL_M <= MAX_EXTENT_M, "a ground cell is off the map")
        _require((high - low) * CELL_M <= MAX_WINDOW_M, f"ground spans over {MAX_WINDOW_M:.0f} m")
    if not ascend:
        codes = np.sort(cell_codes(ground.ix, ground.iy))
        _require(bool((codes[1:] > codes[:-1]).all()), "two rows for one ground cell")


def _check_instances(diff: SemanticMapDiff) -> None:
    instances = diff.instances
    if len(instances) == 0:
        return
    ids = instances.id
    _require(len(set(ids.tolist())) == len(ids), "two rows for one instance")
    _require(int(ids.min()) > 0, "an instance without a positive id")
    in_range = all_between(instances.confidence, -1.01, 1.01) and all_between(
        instances.view_direction.ravel(), -1.01, 1.01
    )
    _require(in_range, "an instance value out of range")


def _require(holds: bool, complaint: str) -> None:
    if not holds:
        raise RefusedDiffError(complaint)
