"""Poses of a car against the truth, in the car's own axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.diffing.removal import LookedFor
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.pose import inverse


@dataclass(frozen=True)
class LocalizationErrors:
    """Position errors of the localised frames, N rows, metres in the true camera frame.

    Attributes:
        across, up, along: (N,) signed, to the right, upwards and ahead of the true camera.
        localized_fraction: share of all frames that were localised in the stored map.
    """

    across: NDArray[np.float64]
    up: NDArray[np.float64]
    along: NDArray[np.float64]
    localized_fraction: float

    def metrics(self) -> dict[str, float]:
        """Flat names for reports; medians and 95th percentiles of the absolute errors."""
        errors = np.stack([self.across, self.up, self.along], axis=1)
        out = {"localized_fraction": self.localized_fraction, "localized_frames": float(len(errors))}
        if not len(errors):
            return out
        total = np.linalg.norm(errors, axis=1)
        for name, values in (("position", total), ("across", self.across), ("up", self.up), ("along", self.along)):
            out[f"{name}_error_median_cm"] = 100 * float(np.median(np.abs(values)))
            out[f"{name}_error_p95_cm"] = 100 * float(np.percentile(np.abs(values), 95))
        return out


def localization_errors(tracked: list[TrackedFrame], T_map_true: NDArray[np.float64]) -> LocalizationErrors:
    """Errors of a drive's frames against true poses (N, 4, 4) in the map frame."""
    localized = np.array([t.state is TrackingState.LOCALIZED for t in tracked])
    estimates = np.stack([t.T_map_cam for t in tracked])[localized]
    offset = (inverse(T_map_true[localized]) @ estimates)[:, :3, 3]
    return LocalizationErrors(offset[:, 0], -offset[:, 1], offset[:, 2], float(localized.mean()))


def removal_metrics(diffs: list[SemanticMapDiff], looked_for: list[LookedFor]) -> dict[str, float]:
    """How many of the stored features that should have been seen the diffs of a drive call removed."""
    predicted = np.unique(np.concatenate([seen.map_id[seen.matched + seen.missed > 0] for seen in looked_for]))
    removed = np.unique(np.concatenate([diff.removed for diff in diffs]))
    return {
        "predicted_visible": float(len(predicted)),
        "removed": float(len(removed)),
        "removed_fraction": len(removed) / max(len(predicted), 1),
    }
