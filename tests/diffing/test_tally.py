"""Counts by id agree with counting by hand."""

from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from autowaze.vehicle.diffing.tally import Tally

frames = st.lists(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 3)), max_size=12), max_size=8)


@given(frames)
def test_counts_and_majorities(observed: list[list[tuple[int, int]]]) -> None:
    tally = Tally()
    for frame in observed:
        pairs = np.array(frame, dtype=np.int64).reshape(-1, 2)
        tally.add(pairs[:, 0], pairs[:, 1])
    flat = [pair for frame in observed for pair in frame]
    ids, counts = tally.counts()
    assert dict(zip(ids.tolist(), counts.tolist(), strict=True)) == Counter(i for i, _ in flat)
    _, table = tally.table(4)
    for row, i in enumerate(ids.tolist()):
        assert table[row].tolist() == [flat.count((i, value)) for value in range(4)]
    ids, majority = tally.majority()
    for i, value in zip(ids.tolist(), majority.tolist(), strict=True):
        votes = Counter(v for j, v in flat if j == i)
        assert value == min(v for v in votes if votes[v] == max(votes.values()))
