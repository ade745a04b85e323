"""Where a drive's ground truth lies in the map, and what a car is told of its start."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from autowaze.traces import GroundTruth, Trace
from autowaze.vehicle.node import StartingPoint
from autowaze.world.errors import AutowazeError
from autowaze.world.parking import ParkingMap
from autowaze.world.pose import Pose, heading_to_rotation, make_pose


class Start(StrEnum):
    """What a car knows of where it starts."""

    GNSS = "gnss"
    """The fixes of the trace, or nothing where it has none."""
    ORIGIN = "origin"
    """It stands level at the map's origin and looks along the survey's heading."""
    FIRST_TRUE_POSE = "first-true-pose"
    """The ground truth of the first frame, and of no other, as if surveyed."""


def map_from_world(truth: GroundTruth, spots: ParkingMap | None) -> Pose:
    """T_map_world: the pose of the ground truth's frame in the map.

    KITTI's world is its first camera, which stands at the origin of the parking map and looks along the heading that
    the file states (north without a file).
    """
    if truth.in_map_frame:
        return np.eye(4)
    return make_pose(heading_to_rotation(_survey_heading(spots)), np.zeros(3))


def true_poses(trace: Trace, spots: ParkingMap | None) -> NDArray[np.float64]:
    """T_map_cam (N, 4, 4) of a trace's ground truth.

    Raises:
        AutowazeError: the trace has none.
    """
    if trace.ground_truth is None:
        raise AutowazeError(f"{trace.name}: no ground-truth poses to compare with; KITTI drives keep them in poses.txt")
    return np.asarray(map_from_world(trace.ground_truth, spots) @ trace.ground_truth.T_world_cam, dtype=np.float64)


def starting_point(trace: Trace, spots: ParkingMap | None, start: Start) -> StartingPoint:
    """What the car of this trace is told."""
    georeference = spots.georeference if spots else None
    if start is Start.FIRST_TRUE_POSE:
        return StartingPoint(georeference, true_poses(trace, spots)[0])
    if start is Start.ORIGIN:
        return StartingPoint(georeference, make_pose(heading_to_rotation(_survey_heading(spots)), np.zeros(3)))
    return StartingPoint(georeference)


def _survey_heading(spots: ParkingMap | None) -> float:
    return (spots.survey_heading_rad if spots else None) or 0.0
