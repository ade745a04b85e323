"""Blocks: the features that came with one diff, numbered by its session and place in it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from autowaze.cloud.diff_kernels import starts_of_blocks
from autowaze.world.feature_map import MapFeatures
from autowaze.world.identity import ROW_BITS, SEQUENCE_BITS
from autowaze.world.map_diff import SemanticMapDiff


def block_of(diff: SemanticMapDiff) -> int:
    """Number of the block of features that a diff brings."""
    return diff.session << SEQUENCE_BITS | diff.sequence


def by_number(ids: NDArray[np.uint64]) -> list[tuple[int, NDArray[np.uint64]]]:
    """Ascending ids (K,) split by the number of their block."""
    starts = starts_of_blocks(ids).tolist()
    return [(int(ids[a]) >> ROW_BITS, ids[a:b]) for a, b in pairwise(starts)]


def by_block(features: MapFeatures) -> list[tuple[int, MapFeatures]]:
    """Features (N,) split by the diff that brought them, each part sorted by id."""
    if len(features) == 0:
        return []
    if (features.id[1:] < features.id[:-1]).any():
        features = features[np.argsort(features.id, kind="stable")]
    numbers, starts = np.unique(features.id >> np.uint64(ROW_BITS), return_index=True)
    ends = np.append(starts[1:], len(features))
    return [(int(n), features[slice(a, b)]) for n, a, b in zip(numbers, starts, ends, strict=True)]
