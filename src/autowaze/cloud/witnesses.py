"""Whose word each session is: sessions of one source are one witness, however many there are."""

from __future__ import annotations

from typing import Any

import numpy as np

from autowaze.world.feature_map import FeatureMap
from autowaze.world.identity import INSTANCE_BITS, ROW_BITS, SEQUENCE_BITS

SURVEY = 0
"""The source of all that the base map says."""


class Witnesses:
    """Sources by session; a session of which no source is known stands for itself.

    Args:
        base_map: what it tells comes from one witness, whoever drove for it.
    """

    def __init__(self, base_map: FeatureMap | None = None) -> None:
        surveyed = (base_map or FeatureMap()).features
        sessions = [
            surveyed.id >> np.uint64(SEQUENCE_BITS + ROW_BITS),
            surveyed.instance_key >> np.uint64(INSTANCE_BITS),
        ]
        self._sources = dict.fromkeys(np.unique(np.concatenate(sessions)).tolist(), SURVEY)

    def note(self, session: int, source: int | None) -> int:
        """Learn the source of a session that reports; returns whose word it is."""
        if source is not None:
            self._sources[session] = source
        elif self._sources.get(session) == SURVEY:
            del self._sources[session]
        return self.of(session)

    def kept(self) -> dict[str, Any]:
        """What it holds, for a snapshot."""
        return {"sources": dict(self._sources)}

    def restore(self, kept: dict[str, Any]) -> None:
        """Hold what a snapshot kept."""
        self._sources = kept["sources"]

    def of(self, session: int) -> int:
        """Whose word a session is."""
        return self._sources.get(session, session)
