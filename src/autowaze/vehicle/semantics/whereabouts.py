"""Where over ground the middles of vehicles stand, by looks at their sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.vehicle.semantics.instance_depth import InstanceDepths
from autowaze.world.camera import StereoCamera
from autowaze.world.columns import Columns
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import Pose, transform

LENGTH_M = np.full(len(ClassLabel), 4.4)
"""Usual length of a vehicle by its class."""
_WIDTH_M = np.full(len(ClassLabel), 1.8)
LENGTH_M[[ClassLabel.TRUCK, ClassLabel.BUS]], _WIDTH_M[[ClassLabel.TRUCK, ClassLabel.BUS]] = (8.0, 11.0), 2.5

_BORDER_PX = 3.0
_BESIDE, _BESIDE_PX = 0.05, 3.0  # gap to a nearer box, of the own width and in px, within which that one may hide more
_SAME_HEIGHT = 0.3
_SHAPE_SIGMA_M = 0.35  # vehicles are no rectangles of one size
_DISPARITY_SIGMA_PX = 0.15  # of many features together
_SHARE = 0.2  # of what one frame tells: the next ones err alike
_GOOD_M = 0.6, 1.2  # sigma across and along the line of sight up to which a sighting can tell two bays apart


@dataclass
class Sightings(Columns):
    """N looks at vehicles.

    Attributes:
        place: (N, 2) float64, middle of the vehicle over ground in metres; NaN where unknown.
        covariance: (N, 2, 2) float64, m^2.
        good: (N,) bool, precise enough to tell bays apart.
    """

    place: NDArray[np.float64]
    covariance: NDArray[np.float64]
    good: NDArray[np.bool_]


class GroundPlane:
    """Two axes over ground in the map, right and ahead of the camera that it was made for."""

    def __init__(self, T_map_cam: Pose) -> None:
        right, down = T_map_cam[:3, 0], T_map_cam[:3, 1]
        self.axes = np.stack([right, np.cross(right, down)])

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the map as (..., 2)."""
        return np.asarray(points @ self.axes.T)


def look(
    camera: StereoCamera,
    ground: GroundPlane,
    T_map_cam: Pose,
    boxes: NDArray[np.floating],
    labels: NDArray[np.uint8],
    depths: InstanceDepths,
) -> Sightings:
    """Where the vehicles in boxes (N, 4) stand.

    The visible faces of a rectangle lie, on average, its area over twice its apparent width before its middle, from
    wherever one looks; and its middle is seen in the middle of its outline. Of a vehicle that the border of the image
    or a nearer one cuts, the width is anything from what is seen to its diagonal, and the other edge tells the middle.
    """
    box = np.asarray(boxes, np.float64)
    left, _, right, _ = ((box - [camera.cx, camera.cy] * 2) / ([camera.fx, camera.fy] * 2)).T
    z = (depths.left + depths.right) / 2
    own = own_edges(camera, box)
    length, width = LENGTH_M[labels], _WIDTH_M[labels]
    widest = np.hypot(length, width)
    narrowest = np.clip((right - left) * z, width, widest)
    whole = np.where(own.all(axis=1), narrowest, (narrowest + widest) / 2)
    doubt = np.where(own.all(axis=1), 0.0, (widest - narrowest) / np.sqrt(12.0))
    middle = z + length * width / (2 * whole)
    x = np.where(own[:, 0], left * middle + whole / 2, right * middle - whole / 2)
    x = np.where(own[:, 0] == own[:, 1], (left + right) / 2 * middle, x)
    across = np.hypot(_SHAPE_SIGMA_M, np.where(own.any(axis=1), doubt / 2, doubt))
    spread = (depths.far - depths.near) / 4
    along = np.sqrt(_SHAPE_SIGMA_M**2 + (_DISPARITY_SIGMA_PX * z**2 / camera.bf) ** 2 + (doubt / 4) ** 2 + spread**2)
    place = ground(transform(T_map_cam, np.stack([x, np.zeros_like(x), middle], axis=1)))
    sight = place - ground(T_map_cam[:3, 3])
    sight /= np.maximum(np.linalg.norm(sight, axis=1), 1e-9)[:, None]
    axes = np.stack([sight[:, ::-1] * [1, -1], sight], axis=2)
    covariance = np.einsum("nij,nj,nkj->nik", axes, np.stack([across, along], axis=1) ** 2, axes)
    good = np.isfinite(z) & own.any(axis=1) & (across < _GOOD_M[0]) & (along < _GOOD_M[1])
    return Sightings(place, covariance, good)


def own_edges(camera: StereoCamera, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which left and right edges (N, 2) are the vehicles' own: no border of the image, and nothing nearer beside."""
    left, top, right, bottom = boxes.T
    own = np.stack([left > _BORDER_PX, right < camera.width - _BORDER_PX], axis=1)
    gap = np.maximum(_BESIDE * (right - left), _BESIDE_PX)[:, None]
    nearer = bottom[None, :] > bottom[:, None] + 1.0
    overlap = np.minimum(bottom[:, None], bottom[None, :]) - np.maximum(top[:, None], top[None, :])
    beside = nearer & (overlap > _SAME_HEIGHT * (bottom - top)[:, None])
    for side, edge in enumerate((left[:, None], right[:, None])):
        covered = beside & (left[None, :] - gap < edge) & (edge < right[None, :] + gap)
        own[:, side] &= ~covered.any(axis=1)
    return own


class Whereabouts:
    """Places of the tracks by all that was seen of them, one row per track; in information form."""

    def __init__(self) -> None:
        self._information = np.zeros((0, 2, 2))
        self._vector = np.zeros((0, 2))

    def add(self, n: int) -> None:
        """Append tracks without a place."""
        self._information = np.concatenate([self._information, np.zeros((n, 2, 2))])
        self._vector = np.concatenate([self._vector, np.zeros((n, 2))])

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Drop the other tracks."""
        self._information, self._vector = self._information[rows], self._vector[rows]

    def take_in(self, rows: NDArray[np.int64], sightings: Sightings) -> None:
        """Take in where the tracks of these rows were seen in this frame."""
        known = np.flatnonzero(np.isfinite(sightings.covariance).all(axis=(1, 2)))
        rows, seen = rows[known], sightings[known]
        information = _SHARE * np.linalg.inv(seen.covariance)
        self._information[rows] += information
        self._vector[rows] += np.einsum("nij,nj->ni", information, seen.place)

    def places(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Middles (n, 2) and their covariances (n, 2, 2), very large where nothing is known."""
        covariance = np.asarray(np.linalg.inv(self._information[rows] + 1e-6 * np.eye(2)), np.float64)
        return np.einsum("nij,nj->ni", covariance, self._vector[rows]), covariance
