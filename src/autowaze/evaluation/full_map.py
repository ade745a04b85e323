"""What a car with visual SLAM alone would send: its whole map, without labels, at the end of every window.

The thesis's first baseline (sec. 4.1.4). The map is what this drive holds of the world, its own landmarks and those of
the stored map that it found again, so it lies where the diffs of the same drive lie and differs from them in content
alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.landmarks import Landmarks
from autowaze.world.feature_map import MapFeatures
from autowaze.world.ground import GroundCells
from autowaze.world.identity import MAX_FEATURES_PER_DIFF, feature_ids
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import InstanceSummaries, SemanticMapDiff, Traffic
from autowaze.world.wire import encode_diff

_REACH_M = 300.0
"""Farther from the path a landmark of a stereo pair is a direction, no place."""


@dataclass
class FullMapUpload:
    """Gathers a drive's map window by window.

    Attributes:
        sizes: bytes of the whole map at the end of each window.
        looked: per window a message without features: where the car looked. Visual SLAM would not send it; without it
            no spot could be told to have been in view, and every method is told.
    """

    sizes: list[int] = field(default_factory=list)
    looked: list[bytes] = field(default_factory=list)
    _features: MapFeatures = field(default_factory=MapFeatures.empty)

    def after_window(self, landmarks: Landmarks, diff: SemanticMapDiff) -> list[bytes]:
        """The messages of a window that has just closed: what was looked at so far, then the whole map."""
        self._take_over(landmarks, diff.trajectory.position)
        window = len(self.sizes)
        bare = replace(
            diff,
            new=MapFeatures.empty(),
            removed=np.zeros(0, np.uint64),
            instances=InstanceSummaries.empty(),
            traffic=Traffic.empty(),
        )
        self.looked.append(encode_diff(replace(bare, sequence=window)))
        parts: list[bytes] = []
        for first in range(0, len(self._features), MAX_FEATURES_PER_DIFF):
            part = self._features[first : first + MAX_FEATURES_PER_DIFF]
            # after every message that says where a car looked
            sequence = 2048 + len(parts)
            part = replace(part, id=feature_ids(diff.session, sequence, len(part)))
            message = replace(bare, sequence=sequence, ground=GroundCells.empty(), new=part)
            parts.append(encode_diff(message))
        self.sizes.append(sum(map(len, parts)))
        return [*self.looked, *parts]

    def _take_over(self, landmarks: Landmarks, path: NDArray[np.float64]) -> None:
        """Add what is new and move what moved; the car forgets what lies far behind, a map does not."""
        if len(path) == 0:
            return
        is_near = np.linalg.norm(landmarks.position - path.mean(axis=0), axis=1) < _REACH_M
        rows = np.flatnonzero(is_near & (~landmarks.is_stored | (landmarks.n_found > 0)))
        seen = _unlabelled(landmarks, rows)
        before = self._features[~np.isin(self._features.id, seen.id)]
        self._features = MapFeatures.concatenate([before, seen])


def _unlabelled(landmarks: Landmarks, rows: NDArray[np.int64]) -> MapFeatures:
    count = len(rows)
    return MapFeatures(
        id=landmarks.id[rows].astype(np.uint64),
        position=landmarks.position[rows],
        descriptor=landmarks.descriptor[rows],
        normal=landmarks.normal[rows],
        min_distance=landmarks.min_distance[rows],
        max_distance=landmarks.max_distance[rows],
        label=np.full(count, ClassLabel.BACKGROUND, np.uint8),
        instance_key=np.zeros(count, np.uint64),
        first_seen=landmarks.first_seen[rows],
        last_seen=landmarks.last_seen[rows],
        observations=np.minimum(landmarks.n_found[rows], 0xFFFF).astype(np.uint16),
    )
