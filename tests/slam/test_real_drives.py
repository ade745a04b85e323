"""Bars on real stereo video; a drive is read once for all tests of the module."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_street import stored_map

from autowaze.evaluation.trajectory import absolute_errors, relative_errors
from autowaze.traces import open_trace
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackingState
from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.world.pose import heading_to_rotation, inverse, make_pose

TO_ENU = make_pose(heading_to_rotation(0.0), np.zeros(3))


@pytest.mark.parametrize(("name", "rpe_cm", "ape_m"), [("odometry_00", 1.6, 0.28), ("drive_0005", 1.3, 0.12)])
def test_odometry(kitti: Path, name: str, rpe_cm: float, ape_m: float) -> None:
    trace = open_trace(kitti / name)
    extractor, slam = FeatureExtractor(trace.camera), StereoSlam(trace.camera)
    frames = [slam.track(extractor.extract(f), f.timestamp, f.index) for f in trace]
    slam.finish()
    assert trace.ground_truth is not None
    poses, truth = np.stack([f.T_map_cam for f in frames]), trace.ground_truth.T_world_cam
    assert all(f.is_trustworthy for f in frames)
    assert 100 * relative_errors(poses, truth).mean <= rpe_cm
    assert absolute_errors(poses, truth).rmse <= ape_m


@pytest.mark.parametrize("with_prior", [True, False])
def test_the_colour_rig_localises_in_the_map_of_the_grey_one(kitti: Path, with_prior: bool) -> None:
    grey, colour = (open_trace(kitti / "drive_0005", cameras=c, frames=slice(110, 154)) for c in ("grey", "colour"))
    assert grey.ground_truth is not None
    assert colour.ground_truth is not None
    truth = TO_ENU @ colour.ground_truth.T_world_cam
    mapper = StereoSlam(grey.camera, T_map_start=TO_ENU @ grey.ground_truth.T_world_cam[0])
    extractor = FeatureExtractor(grey.camera)
    for f in grey:
        mapper.track(extractor.extract(f), f.timestamp, f.index)
    mapper.finish()
    prior = (truth[0, :3, 3] + [2.0, -2.0, 0.5], 3.0) if with_prior else None
    slam = StereoSlam(colour.camera, stored_map=stored_map(mapper), position_prior=prior)
    frames = [slam.track(extractor.extract(f), f.timestamp, f.index) for f in colour]
    slam.finish()
    localized = np.array([f.state == TrackingState.LOCALIZED for f in frames])
    error = (inverse(truth) @ np.stack([f.T_map_cam for f in frames]))[localized, :3, 3]
    across, up, along = np.median(np.abs(error), axis=0)
    assert localized.mean() >= 0.95
    assert max(across, up) <= 0.03
    assert along <= 0.12  # the colour pair is exposed 6-10 ms earlier
