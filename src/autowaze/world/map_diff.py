"""The semantic map diff: what one car saw change in one time window."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from autowaze.world.columns import Columns
from autowaze.world.feature_map import MapFeatures
from autowaze.world.georeference import Georeference
from autowaze.world.ground import GroundCells


@dataclass
class InstanceSummaries(Columns):
    """Static instances that the window's features belong to, N rows.

    Attributes:
        id: (N,) int32, the track's positive id within the session.
        label: (N,) uint8, a `ClassLabel`.
        confidence: (N,) float32, mean over the frames, 0..1.
        view_direction: (N, 2) float32, mean horizontal unit vector from the camera to the instance, map frame: the
            side of a car that yields points is the one that faces against it.
        frames: (N,) uint16, frames of the window in which it was seen.
    """

    id: NDArray[np.int32]
    label: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    view_direction: NDArray[np.float32]
    frames: NDArray[np.uint16]

    @classmethod
    def empty(cls) -> InstanceSummaries:
        """No instances."""
        return cls(
            np.zeros(0, np.int32),
            np.zeros(0, np.uint8),
            np.zeros(0, np.float32),
            np.zeros((0, 2), np.float32),
            np.zeros(0, np.uint16),
        )


@dataclass
class Traffic(Columns):
    """Moving objects of the window, N rows; they are no map features.

    Attributes:
        id: (N,) int32, the track's id within the session.
        label: (N,) uint8, a `ClassLabel`.
        position: (N, 2) float32, metres in the map frame, where last seen.
        velocity: (N, 2) float32, m/s in the map frame.
    """

    id: NDArray[np.int32]
    label: NDArray[np.uint8]
    position: NDArray[np.float32]
    velocity: NDArray[np.float32]

    @classmethod
    def empty(cls) -> Traffic:
        """No traffic."""
        return cls(
            np.zeros(0, np.int32), np.zeros(0, np.uint8), np.zeros((0, 2), np.float32), np.zeros((0, 2), np.float32)
        )


@dataclass
class Trajectory(Columns):
    """Where the car was, about once a second, N rows.

    Attributes:
        time: (N,) float64, seconds since the epoch (UTC).
        position: (N, 3) float64, metres in the map frame.
        heading: (N,) float32, clockwise from north, radians.
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    heading: NDArray[np.float32]

    @classmethod
    def empty(cls) -> Trajectory:
        """Nowhere."""
        return cls(np.zeros(0), np.zeros((0, 3)), np.zeros(0, np.float32))


@dataclass(frozen=True)
class SemanticMapDiff:
    """One upload (thesis, sec. 3.2.6).

    Attributes:
        session: the vehicle session, a 39-bit number (`world.identity`).
        sequence: number of the window within the session; (session, sequence) is the key of the diff.
        start, end: the window, seconds since the epoch (UTC).
        map_version: version of the stored map that it was compared with.
        georeference: origin of the map frame that all coordinates are in.
        frames, localized_frames: frames of the window, and those whose pose was good.
        position_sigma_m: one standard deviation of the position, median over the window, metres.
        new: features of the world that the map lacks; ids are `feature_ids(session, sequence, len(new))`. Features
            of vehicles may come without descriptor (all zero): nobody localises by them.
        removed: (R,) uint64, sorted ids of map features that are gone.
        instances: the static instances of the new features and those seen again.
        ground: the ground that was seen.
        traffic: moving objects.
        trajectory: the car's path.
    """

    session: int
    sequence: int
    start: float
    end: float
    map_version: int = 0
    georeference: Georeference | None = None
    frames: int = 0
    localized_frames: int = 0
    position_sigma_m: float = 0.0
    new: MapFeatures = field(default_factory=MapFeatures.empty)
    removed: NDArray[np.uint64] = field(default_factory=lambda: np.zeros(0, np.uint64))
    instances: InstanceSummaries = field(default_factory=InstanceSummaries.empty)
    ground: GroundCells = field(default_factory=GroundCells.empty)
    traffic: Traffic = field(default_factory=Traffic.empty)
    trajectory: Trajectory = field(default_factory=Trajectory.empty)

    @property
    def key(self) -> tuple[int, int]:
        """What makes the diff one of a kind."""
        return self.session, self.sequence
