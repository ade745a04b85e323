"""Which votes for boxes speak of one instance.

Candidates are boxes on which some votes agree. Two parked cars often share a third of their boxes, and the votes of
one car scatter as widely, so no single overlap tells two instances from one. Therefore the candidates compete: a set
of them is chosen that represents all votes well, where each must represent its own votes clearly better than what is
chosen already, and one whose votes do not fill it counts for less. That is facility location, after Barinova,
Lempitsky and Kohli ("On detection of multiple object instances using Hough transforms", CVPR 2010), solved greedily.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

MAX_INSTANCES = 100

_SEED_SCORE = 0.15
"""Of the best vote of a candidate."""
_AGREEMENT, _KNOWN = 0.6, 0.8
"""Overlap of two votes that speak for one candidate; of two candidates of which one is enough."""
_SUPPORT, _NO_SUPPORT = 0.5, 0.25
"""Overlap with a candidate from which a vote is one of its own; below which it says nothing for it."""
_WORTH = 0.13
"""By how much a candidate must represent its own votes better, in overlap, to be an instance of its own."""
_OWN = 0.2
"""Least overlap of a vote with the instance that it belongs to."""
_REFINEMENTS = 2
_STRAY = 0.005
"""Share of an instance's cells that may lie beyond each side of what it fills."""
_MIN_CELLS = 8
_CELLS_AT_MOST = 8000
"""Of which candidates are made; of more, every second or third row and column speaks for its neighbours."""
_MARGIN, _MARGIN_SHARE = 4.0, 0.05
"""How far outside an instance's box a vote for it may lie: input pixels, plus a share of the box's size."""


def instances_of_votes(
    at: NDArray[np.float32],
    boxes: NDArray[np.float32],
    kinds: NDArray[np.int64],
    probability: NDArray[np.float32],
    quality: NDArray[np.float32],
    stride: int,
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]:
    """Group N votes into K instances.

    Args:
        at: (N, 2) x, y of the voting cells' centres, in input pixels.
        boxes: (N, 4) left, top, right, bottom of the voted boxes, in input pixels.
        kinds: (N,) class of each vote; votes of different classes are never one instance.
        probability: (N,) of the vote's class, 0..1.
        quality: (N,) expected overlap of the voted box with the true one, 0..1.
        stride: input pixels from cell to cell.

    Returns:
        owner: (N,) instance of each vote, -1 for none.
        confidence: (K,) 0..1, 0 for instances of a few cells.
        kind: (K,) class of each instance.
    """
    score = probability * quality
    speaking = _speaking(at, stride)
    speaking = speaking[np.argsort(-score[speaking], kind="stable")]
    votes = boxes[speaking], kinds[speaking], score[speaking], at[speaking]
    sparse = max(1.0, len(boxes) / max(len(speaking), 1))
    candidates, kind = _candidates(*votes[:3], max(2, int(_MIN_CELLS / sparse)))
    chosen = _chosen(*votes, candidates, kind)
    instances, kind = candidates[chosen], kind[chosen]
    for _ in range(_REFINEMENTS):
        instances = _refined(*votes, instances, kind)
    owner = _owners(boxes, kinds, at, instances, kind)
    return owner, _confidence(boxes, probability, at, owner, len(instances), float(stride)), kind


def _speaking(at: NDArray[np.float32], stride: int) -> NDArray[np.int64]:
    """Votes on a lattice, so coarse that there are not too many."""
    step = int(np.ceil(np.sqrt(len(at) / _CELLS_AT_MOST)))
    if step <= 1:
        return np.arange(len(at))
    on = (at.astype(np.int64) // stride % step == 0).all(axis=1)
    return np.flatnonzero(on)


@numba.njit(cache=True)
def _overlap(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    """IoU of two boxes (4,)."""
    w = min(a[2], b[2]) - max(a[0], b[0])
    h = min(a[3], b[3]) - max(a[1], b[1])
    if w <= 0 or h <= 0:
        return 0.0
    both = w * h
    return float(both / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - both))


@numba.njit(cache=True)
def _near(at: NDArray[np.float32], box: NDArray[np.float32]) -> bool:
    """Whether a vote may come from this place (2,) for this box (4,)."""
    dx = _MARGIN + _MARGIN_SHARE * (box[2] - box[0])
    dy = _MARGIN + _MARGIN_SHARE * (box[3] - box[1])
    return bool(box[0] - dx <= at[0] <= box[2] + dx and box[1] - dy <= at[1] <= box[3] + dy)


@numba.njit(cache=True)
def _candidates(
    boxes: NDArray[np.float32], kinds: NDArray[np.int64], score: NDArray[np.float32], min_cells: int
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Boxes (M, 4) on which votes agree, with their classes; the votes come in falling order of score.

    The best vote that nobody speaks for yet asks all others like it; their weighted mean is a candidate.
    """
    free = np.arange(len(boxes))
    found = np.empty((MAX_INSTANCES, 4), np.float32)
    kind = np.empty(MAX_INSTANCES, np.int64)
    count = 0
    while len(free) and count < MAX_INSTANCES and score[free[0]] >= _SEED_SCORE:
        seed, own_kind = boxes[free[0]], kinds[free[0]]
        mean, weight, agreeing = np.zeros(4), 1e-9, 0
        for i in free:
            overlap = _overlap(boxes[i], seed) if kinds[i] == own_kind else 0.0
            if overlap > _AGREEMENT:
                agreeing += 1
                w = score[i] * (overlap - _AGREEMENT)
                weight += w
                for side in range(4):
                    mean[side] += w * boxes[i, side]
        centre = (mean / weight).astype(np.float32)
        left = np.empty(len(free), np.int64)
        n_left = 0
        for position, i in enumerate(free):
            own = _overlap(boxes[i], centre) > _AGREEMENT or _overlap(boxes[i], seed) > _AGREEMENT
            if position > 0 and not (kinds[i] == own_kind and own):
                left[n_left] = i
                n_left += 1
        free = left[:n_left]
        known = False
        for k in range(count):
            known = known or (kind[k] == own_kind and _overlap(found[k], centre) > _KNOWN)
        if agreeing >= min_cells and not known:
            found[count], kind[count] = centre, own_kind
            count += 1
    return found[:count], kind[:count]


@numba.njit(cache=True)
def _chosen(
    boxes: NDArray[np.float32],
    kinds: NDArray[np.int64],
    score: NDArray[np.float32],
    at: NDArray[np.float32],
    candidates: NDArray[np.float32],
    kind: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Numbers of the candidates that are instances, the one that represents most votes first."""
    count = len(candidates)
    worth = np.zeros((count, len(boxes)), np.float32)
    support = np.zeros(count)
    own = np.empty(len(boxes), np.bool_)
    for k in range(count):
        for i in range(len(boxes)):
            near = kinds[i] == kind[k] and _near(at[i], candidates[k])
            overlap = _overlap(boxes[i], candidates[k]) if near else 0.0
            worth[k, i] = score[i] * max(overlap - _NO_SUPPORT, 0.0)
            own[i] = overlap > _SUPPORT
            support[k] += score[i] * own[i]
        worth[k] *= np.float32(_overlap(_filled(at[own], 0.0), candidates[k]))
    gain = worth.sum(axis=1) - _WORTH * support
    represented = np.zeros(len(boxes), np.float32)
    current = np.ones(count, np.bool_)
    chosen = np.empty(count, np.int64)
    n_chosen = 0
    while count:
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        if not current[best]:
            # gains only fall: what is not the best by an old one is not the best (Minoux 1978)
            gain[best] = -_WORTH * support[best]
            for i in range(len(boxes)):
                gain[best] += max(worth[best, i] - represented[i], np.float32(0.0))
            current[best] = True
            continue
        chosen[n_chosen] = best
        n_chosen += 1
        represented = np.maximum(represented, worth[best])
        current[:] = False
        gain[best] = 0.0
    return chosen[:n_chosen]


@numba.njit(cache=True)
def _filled(at: NDArray[np.float32], half: float) -> NDArray[np.float32]:
    """Box (4,) round cells (N, 2) of this half size but for a few strays."""
    box = np.zeros(4, np.float32)
    if len(at):
        stray = int(_STRAY * len(at))
        for axis in range(2):
            along = at[:, axis].copy()
            last = len(along) - 1 - stray
            box[axis] = np.partition(along, stray)[stray] - half
            box[axis + 2] = np.partition(along, last)[last] + half
    return box


@numba.njit(cache=True)
def _owners(
    boxes: NDArray[np.float32],
    kinds: NDArray[np.int64],
    at: NDArray[np.float32],
    instances: NDArray[np.float32],
    kind: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Number of the instance (N,) whose box is most like each vote, -1 where none is."""
    owner = np.full(len(boxes), -1, np.int64)
    for i in range(len(boxes)):
        best = _OWN
        for k in range(len(instances)):
            if kinds[i] == kind[k] and _near(at[i], instances[k]):
                overlap = _overlap(boxes[i], instances[k])
                if overlap > best:
                    best, owner[i] = overlap, k
    return owner


@numba.njit(cache=True)
def _refined(
    boxes: NDArray[np.float32],
    kinds: NDArray[np.int64],
    score: NDArray[np.float32],
    at: NDArray[np.float32],
    instances: NDArray[np.float32],
    kind: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Each instance's box (K, 4) as the weighted mean of the votes that are its own."""
    owner = _owners(boxes, kinds, at, instances, kind)
    total, weight = np.zeros((len(instances), 4)), np.zeros(len(instances))
    for i in range(len(boxes)):
        if owner[i] >= 0:
            weight[owner[i]] += score[i]
            total[owner[i]] += score[i] * boxes[i]
    refined = instances.copy()
    for k in range(len(instances)):
        if weight[k] > 0:
            refined[k] = (total[k] / weight[k]).astype(np.float32)
    return refined


@numba.njit(cache=True)
def _confidence(
    boxes: NDArray[np.float32],
    probability: NDArray[np.float32],
    at: NDArray[np.float32],
    owner: NDArray[np.int64],
    count: int,
    stride: float,
) -> NDArray[np.float32]:
    """How sure each instance is (count,), 0 for those of a few cells.

    The mean probability of its cells, times the mean overlap of their votes with the mean vote, times the overlap of
    the mean vote with the box that the cells really fill: what is no instance gets votes that contradict each other
    or the picture.
    """
    confidence = np.zeros(count, np.float32)
    for k in range(count):
        own = np.flatnonzero(owner == k)
        if len(own) >= _MIN_CELLS:
            total, agreement = np.zeros(4), 0.0
            for i in own:
                total += boxes[i]
            mean = (total / len(own)).astype(np.float32)
            for i in own:
                agreement += _overlap(boxes[i], mean)
            fit = _overlap(mean, _filled(at[own], 0.5 * stride))
            confidence[k] = probability[own].mean() * (agreement / len(own)) * fit
    return confidence
