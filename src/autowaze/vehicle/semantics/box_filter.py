"""The Kalman filter of SORT over the boxes of all tracks at once (Bewley et al. 2016, sec. III-B).

State per track: u, v (centre, px), s (area, px^2), r (width / height), and the rates of u, v, s per frame; r has none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

N_STATE, N_MEASURED = 7, 4

# Standard deviations relative to the size of the box (sqrt of its area); the paper does not state its own.
_MEASURED_CENTRE, _MEASURED_AREA, _MEASURED_RATIO = 0.04, 0.10, 0.10
_DRIFT_CENTRE, _DRIFT_AREA, _DRIFT_RATIO = 0.02, 0.05, 0.03
_DRIFT_RATE, _DRIFT_AREA_RATE = 0.03, 0.05
_FIRST_RATE, _FIRST_AREA_RATE = 0.5, 0.5
_PIXEL = 1.0  # detections are no better than a pixel, however small the box

_F = np.eye(N_STATE)
_F[[0, 1, 2], [4, 5, 6]] = 1.0

_MIN_AREA, _MIN_RATIO = 1.0, 0.05


def boxes_to_measurements(boxes: NDArray[np.floating]) -> NDArray[np.float64]:
    """Boxes (N, 4) left, top, right, bottom as (N, 4) u, v, s, r."""
    box = np.asarray(boxes, dtype=np.float64)
    width, height = np.maximum(box[:, 2] - box[:, 0], 1.0), np.maximum(box[:, 3] - box[:, 1], 1.0)
    return np.stack([(box[:, 0] + box[:, 2]) / 2, (box[:, 1] + box[:, 3]) / 2, width * height, width / height], axis=1)


def states_to_boxes(states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Boxes (N, 4) left, top, right, bottom of states (N, >= 4)."""
    width = np.sqrt(states[:, 2] * states[:, 3])
    half = np.stack([width, states[:, 2] / width], axis=1) / 2
    return np.concatenate([states[:, :2] - half, states[:, :2] + half], axis=1)


class BoxFilter:
    """Means (N, 7) and covariances (N, 7, 7), one row per track."""

    def __init__(self) -> None:
        self.mean = np.zeros((0, N_STATE))
        self.covariance = np.zeros((0, N_STATE, N_STATE))

    def add(self, measurements: NDArray[np.float64]) -> None:
        """Append tracks at rest at the measured boxes (n, 4)."""
        mean, covariance = _at_rest(measurements)
        self.mean = np.concatenate([self.mean, mean])
        self.covariance = np.concatenate([self.covariance, covariance])

    def predict(self, shift: NDArray[np.float64]) -> None:
        """One frame ahead; `shift` (N, 4) is the known motion of the edges in px, zero where none is known.

        Edges, because the border of the image stops one of them while the others move on.
        """
        size, area = _size(self.mean), self.mean[:, 2]
        drift = np.stack(
            [
                _DRIFT_CENTRE * size,
                _DRIFT_CENTRE * size,
                _DRIFT_AREA * area,
                np.broadcast_to(_DRIFT_RATIO, area.shape),
                _DRIFT_RATE * size,
                _DRIFT_RATE * size,
                _DRIFT_AREA_RATE * area,
            ],
            axis=1,
        )
        self.mean = self.mean @ _F.T
        self._keep_positive()
        shifted = shift.any(axis=1)
        self.mean[shifted, :N_MEASURED] = boxes_to_measurements(states_to_boxes(self.mean[shifted]) + shift[shifted])
        self.covariance = _F @ self.covariance @ _F.T + _diagonal(drift)

    def correct(self, rows: NDArray[np.int64], measurements: NDArray[np.float64]) -> None:
        """Take in the measured boxes (n, 4) of some tracks."""
        mean, P = self.mean[rows], self.covariance[rows]
        S = P[:, :N_MEASURED, :N_MEASURED] + _diagonal(_measured_spread(measurements))
        gain = np.swapaxes(np.linalg.solve(S, P[:, :N_MEASURED]), 1, 2)
        self.mean[rows] = mean + np.einsum("nij,nj->ni", gain, measurements - mean[:, :N_MEASURED])
        self.covariance[rows] = P - gain @ P[:, :N_MEASURED]
        self._keep_positive()

    def restart(self, rows: NDArray[np.int64], measurements: NDArray[np.float64]) -> None:
        """Take tracks to be at rest at the measured boxes (n, 4), whatever was known."""
        self.mean[rows], self.covariance[rows] = _at_rest(measurements)

    def forget_rates(self, rows: NDArray[np.int64]) -> None:
        """Take tracks to be at rest: the centre and area of a box that is cut move with the border."""
        self.mean[rows, N_MEASURED:] = 0.0

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Drop the other tracks."""
        self.mean, self.covariance = self.mean[rows], self.covariance[rows]

    def _keep_positive(self) -> None:
        self.mean[:, 2] = np.maximum(self.mean[:, 2], _MIN_AREA)
        self.mean[:, 3] = np.maximum(self.mean[:, 3], _MIN_RATIO)


def _at_rest(measurements: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means (n, 7) and covariances (n, 7, 7) of tracks of which nothing but the boxes (n, 4) is known."""
    size, area = _size(measurements), measurements[:, 2]
    rate, area_rate = _FIRST_RATE * size, _FIRST_AREA_RATE * area
    spread = np.concatenate([_measured_spread(measurements), np.stack([rate, rate, area_rate], axis=1)], axis=1)
    mean = np.concatenate([measurements, np.zeros((len(measurements), 3))], axis=1)
    return mean, _diagonal(spread)


def _size(measurements: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(measurements[:, 2]))


def _measured_spread(measurements: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviations (N, 4) of measured u, v, s, r."""
    size, area, ratio = _size(measurements), measurements[:, 2], measurements[:, 3]
    centre = _MEASURED_CENTRE * size + _PIXEL
    return np.stack([centre, centre, _MEASURED_AREA * area + _PIXEL * size, _MEASURED_RATIO * (ratio + 1)], axis=1)


def _diagonal(spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances (N, k, k) of independent values with standard deviations (N, k)."""
    return np.asarray(spread[:, :, None] ** 2 * np.eye(spread.shape[1]))
