"""What tracking says about one frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.slam.landmarks import NO_LANDMARK
from autowaze.vehicle.slam.observed_frame import ObservedFrame
from autowaze.world.pose import Pose


class TrackingState(StrEnum):
    """How far a pose can be trusted."""

    INITIALIZING = "initializing"
    """No pose yet: too few features, or not yet found in the stored map."""
    LOCALIZED = "localized"
    """Held by enough features of the stored map."""
    ODOMETRY = "odometry"
    """Visual odometry only: there is no stored map, or a gap in it is being bridged."""
    LOST = "lost"
    """The pose is an extrapolation; do not use it."""


@dataclass(frozen=True)
class TrackedFrame:
    """Pose of one frame and what it was based on.

    Attributes:
        index, timestamp: those of the frame.
        state: how far to trust the pose.
        reason: empty when all is well, else why it is not.
        T_map_cam: (4, 4) float64, camera to map (east, north, up), metres.
        covariance: (6, 6) float64, of the camera's position (m) and of its orientation as a rotation vector (rad),
            both in the map frame; large where the pose is unknown.
        n_inliers: features that agree with the pose.
        n_stored_inliers: those of them that match the stored map.
        landmark_id: (N,) int64, per camera feature the stable id of the landmark that it matched as an inlier or
            that was made from it in this frame; -1 for none.
        visible_id: (M,) int64, ids of the landmarks that geometry alone predicts to be seen: in the frustum, within
            scale range and viewing angle. Whether something hides them is not known here.
    """

    index: int
    timestamp: float
    state: TrackingState
    reason: str
    T_map_cam: Pose
    covariance: NDArray[np.float64]
    n_inliers: int
    n_stored_inliers: int
    landmark_id: NDArray[np.int64]
    visible_id: NDArray[np.int64]

    @classmethod
    def without_pose(
        cls,
        frame: ObservedFrame,
        timestamp: float,
        index: int,
        state: TrackingState,
        reason: str,
        T_map_cam: Pose,
        covariance: NDArray[np.float64],
    ) -> TrackedFrame:
        """A frame whose pose (4, 4) is a guess."""
        none, nothing = np.full(len(frame), NO_LANDMARK, np.int64), np.zeros(0, np.int64)
        return cls(index, timestamp, state, reason, T_map_cam.copy(), covariance.copy(), 0, 0, none, nothing)

    @property
    def is_trustworthy(self) -> bool:
        """Whether the pose may be used: localised or carried by odometry."""
        return self.state in (TrackingState.LOCALIZED, TrackingState.ODOMETRY)

    @property
    def position_sigma_m(self) -> float:
        """One standard deviation of the horizontal position, metres."""
        return float(np.sqrt(max(np.trace(self.covariance[:2, :2]), 0.0)))


def judged(n_stored_inliers: int, needed: int, has_map: bool) -> tuple[TrackingState, str]:
    """State of a frame whose pose holds, and why it is not localised where there is a stored map."""
    if not has_map:
        return TrackingState.ODOMETRY, ""
    if n_stored_inliers >= needed:
        return TrackingState.LOCALIZED, ""
    return TrackingState.ODOMETRY, f"only {n_stored_inliers} features of the stored map in view"
