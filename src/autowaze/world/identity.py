"""How sessions, diffs, features and instances are numbered.

A vehicle session is a random 39-bit number that a car draws when it starts and again before its windows run out, so
it says nothing about the car. A feature's id is (session, sequence number of the diff, row in the diff): it needs no
bytes in the diff that brings it, few in a diff that removes it (neighbours differ by one), and is the same however
often and in whatever order diffs arrive.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SESSION_BITS, SEQUENCE_BITS, ROW_BITS = 39, 12, 12  # ids fit a signed 64-bit column of any database
INSTANCE_BITS = 24

MAX_SESSION = 1 << SESSION_BITS
MAX_SEQUENCE = 1 << SEQUENCE_BITS
MAX_FEATURES_PER_DIFF = 1 << ROW_BITS
MAX_INSTANCE = 1 << INSTANCE_BITS


def feature_ids(session: int, sequence: int, count: int) -> NDArray[np.uint64]:
    """Ids (count,) of the new features of a diff, in row order."""
    first = (session << (SEQUENCE_BITS + ROW_BITS)) | (sequence << ROW_BITS)
    return np.arange(first, first + count, dtype=np.uint64)


def instance_keys(session: int, instance_ids: NDArray[np.integer]) -> NDArray[np.uint64]:
    """Keys (N,) that tell instances of all sessions apart; 0 where the id is 0."""
    ids = np.asarray(instance_ids, dtype=np.uint64)
    keys = np.uint64(session << INSTANCE_BITS) | ids
    return np.where(ids == 0, np.uint64(0), keys)


def session_of_key(instance_key: int) -> int:
    """The session that an instance key belongs to."""
    return int(instance_key) >> INSTANCE_BITS
