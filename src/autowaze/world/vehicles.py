"""Footprints of vehicles that stand on the street."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from autowaze.world.columns import Columns
from autowaze.world.labels import ClassLabel


@dataclass(frozen=True)
class VehicleBox:
    """The footprint of one vehicle.

    Attributes:
        centre: x, y in map metres.
        length_m, width_m: along and across the heading.
        heading_rad: compass heading of the long axis (clockwise from north); front is not told from back.
        group: key of the instance that its points came from, the smallest one if it was seen under several.
        label: class of the vehicle.
        confidence: 0..1, of the class.
        points: map features that it was drawn from.
        seen_at: when it was last seen, seconds since the epoch (UTC).
    """

    centre: tuple[float, float]
    length_m: float
    width_m: float
    heading_rad: float
    group: int
    label: ClassLabel
    confidence: float
    points: int
    seen_at: float

    @property
    def polygon(self) -> shapely.Polygon:
        """Outline in map metres."""
        corners = box_corners(
            np.array([self.centre]),
            np.array([self.length_m]),
            np.array([self.width_m]),
            np.array([self.heading_rad]),
        )
        return shapely.Polygon(corners[0])


@dataclass
class VehicleBoxes(Columns):
    """Footprints, N rows; columns as in `VehicleBox`.

    Attributes:
        centre: (N, 2) float64.
        length, width: (N,) float64, metres.
        heading: (N,) float64, radians clockwise from north.
        group: (N,) uint64.
        label: (N,) uint8.
        confidence: (N,) float64.
        points: (N,) int64.
        seen_at: (N,) float64.
    """

    centre: NDArray[np.float64]
    length: NDArray[np.float64]
    width: NDArray[np.float64]
    heading: NDArray[np.float64]
    group: NDArray[np.uint64]
    label: NDArray[np.uint8]
    confidence: NDArray[np.float64]
    points: NDArray[np.int64]
    seen_at: NDArray[np.float64]

    @classmethod
    def empty(cls) -> VehicleBoxes:
        """No vehicle."""
        zeros = np.zeros(0)
        return cls(
            centre=np.zeros((0, 2)),
            length=zeros,
            width=zeros,
            heading=zeros,
            group=np.zeros(0, np.uint64),
            label=np.zeros(0, np.uint8),
            confidence=zeros,
            points=np.zeros(0, np.int64),
            seen_at=zeros,
        )

    def __iter__(self) -> Iterator[VehicleBox]:
        for i in range(len(self)):
            yield VehicleBox(
                centre=(float(self.centre[i, 0]), float(self.centre[i, 1])),
                length_m=float(self.length[i]),
                width_m=float(self.width[i]),
                heading_rad=float(self.heading[i]),
                group=int(self.group[i]),
                label=ClassLabel(int(self.label[i])),
                confidence=float(self.confidence[i]),
                points=int(self.points[i]),
                seen_at=float(self.seen_at[i]),
            )

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners (N, 4, 2) in map metres."""
        corners: NDArray[np.float64] = _corners(self.centre, self.length, self.width, self.heading)
        return corners

    @property
    def polygons(self) -> NDArray[np.object_]:
        """Outlines (N,) as shapely polygons."""
        return np.asarray(shapely.polygons(self.corners), dtype=np.object_)


def box_corners(
    centre: NDArray[np.float64], length: NDArray[np.float64], width: NDArray[np.float64], heading: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Corners (N, 4, 2) of oriented rectangles; headings (N,) in radians clockwise from north."""
    sine, cosine = np.sin(heading), np.cos(heading)
    half_length, half_width = length / 2, width / 2
    corners = np.empty((len(centre), 4, 2))
    for axis, along, across in (
        (0, sine * half_length, cosine * half_width),
        (1, cosine * half_length, -sine * half_width),
    ):
        front, rear = centre[:, axis] + along, centre[:, axis] - along
        corners[:, 0, axis], corners[:, 1, axis] = front + across, front - across
        corners[:, 2, axis], corners[:, 3, axis] = rear - across, rear + across
    return corners


@njit(cache=True, nogil=True)
def _corners(centre, length, width, heading):  # type: ignore[no-untyped-def]
    """As `box_corners`, for the few boxes of a diff."""
    corners = np.empty((len(centre), 4, 2))
    for row in range(len(centre)):
        sine, cosine = np.sin(heading[row]), np.cos(heading[row])
        for axis in range(2):
            along = (cosine if axis else sine) * (length[row] / 2)
            across = (-sine if axis else cosine) * (width[row] / 2)
            front, rear = centre[row, axis] + along, centre[row, axis] - along
            corners[row, 0, axis], corners[row, 1, axis] = front + across, front - across
            corners[row, 2, axis], corners[row, 3, axis] = rear - across, rear + across
    return corners
