"""How far a pose may be off: what the frame's own matches leave open, and what odometry adds from frame to frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from autowaze.world.pose import Pose

# Squared errors over the variances that pose optimisation states, measured on simulated drives over 0.1 to 20 s: it
# takes landmarks for independent, though what shares a surface or a keyframe shares an error.
_INFLATION = 2.5
_SCALE_SIGMA = 0.001  # of the distance driven: rectification and matching err the same way in every frame
_NO_DRIFT = np.zeros((6, 6))


class PoseUncertainty:
    """Covariance (6, 6) of position (m) and rotation vector (rad) in the map frame, from frame to frame.

    Attributes:
        drift: what odometry has added since the pose was last anchored in a map.
    """

    def __init__(self) -> None:
        self.drift: NDArray[np.float64] = _NO_DRIFT
        self._driven = np.zeros(3)

    def anchor(self, estimate: NDArray[np.float64] = _NO_DRIFT) -> NDArray[np.float64]:
        """The pose is held by something that does not drift; returns its covariance."""
        self.drift = _INFLATION * estimate
        self._driven = np.zeros(3)
        return self.drift

    def become(self, covariance: NDArray[np.float64]) -> None:
        """A loop was closed: this is how uncertain the pose is now."""
        self.drift = covariance

    def widen(self, covariance: NDArray[np.float64]) -> None:
        """Something happened that nobody saw."""
        self.drift = self.drift + covariance

    def correct(self, remaining: NDArray[np.float64]) -> None:
        """Something absolute took errors (6,) of the pose to what this matrix (6, 6) leaves of them."""
        self.drift = remaining @ self._with_scale() @ remaining.T
        self._driven = np.zeros(3)

    def move(self, T_before: Pose, T_after: Pose, estimate: NDArray[np.float64]) -> NDArray[np.float64]:
        """Odometry went on by one frame, whose own covariance is the estimate's; returns the whole covariance.

        An error of the heading turns all motion after it: position errors grow faster than the square root of time.
        """
        step = T_after[:3, 3] - T_before[:3, 3]
        turned = np.eye(6)
        turned[:3, 3:] = [[0.0, step[2], -step[1]], [-step[2], 0.0, step[0]], [step[1], -step[0], 0.0]]
        self.drift = turned @ self.drift @ turned.T + _INFLATION * estimate
        self._driven = self._driven + step
        return self._with_scale()

    def _with_scale(self) -> NDArray[np.float64]:
        covariance = self.drift.copy()
        covariance[:3, :3] += _SCALE_SIGMA**2 * np.outer(self._driven, self._driven)
        return covariance
