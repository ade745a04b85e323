"""Long drives with odometry that drifts, satellite fixes that wander and jump; no images."""

from __future__ import annotations

import numpy as np
import pytest

from autowaze.vehicle.slam.gnss_constraint import GnssConstraint, GnssPosition
from autowaze.vehicle.slam.pose_uncertainty import PoseUncertainty
from autowaze.world.pose import heading_to_rotation, inverse, make_pose, so3_exp

STEP_M, SECONDS = 0.8, 600  # ten minutes at 8 m/s, ten frames a second
FRAMES = 10 * SECONDS
OWN = np.diag([1e-6] * 3 + [2e-9] * 3)  # of a frame's pose, m^2 and rad^2


def true_poses(heading_rate: float = 0.002) -> np.ndarray:
    heading = np.cumsum(np.full(FRAMES, heading_rate)) * np.sin(np.arange(FRAMES) / 400)
    steps = STEP_M * np.stack([np.sin(heading), np.cos(heading), np.zeros(FRAMES)], axis=1)
    return np.stack([make_pose(heading_to_rotation(h), p) for h, p in zip(heading, np.cumsum(steps, 0), strict=True)])


def fixes(truth: np.ndarray, rng: np.random.Generator, jumps: bool) -> np.ndarray:
    """A bias of 1.3 m that wanders over 40 s, noise of 0.35 m; a quarter of the time reflections of 10 to 30 m."""
    keep, bias, places = np.exp(-0.1 / 40), rng.normal(0, 1.3, 3), truth[:, :3, 3].copy()
    for i in range(FRAMES):
        bias = keep * bias + np.sqrt(1 - keep**2) * rng.normal(0, 1.3, 3)
        places[i] += bias + rng.normal(0, 0.35, 3)
    if jumps:
        for first in range(50, FRAMES, 400):
            places[first : first + 100, :2] += rng.uniform(10, 30) * np.array(
                [np.cos(turn := rng.uniform(0, 6.3)), np.sin(turn)]
            )
    return places


def drive(truth, places, start, start_sigma, rng):
    """Errors (FRAMES,) of odometry that is 0.3 % long and turns a hundredth of a degree each metre, held by fixes."""
    T, errors = start, np.zeros(FRAMES)
    uncertainty, constraint = PoseUncertainty(), GnssConstraint(start_sigma)
    for i in range(1, FRAMES):
        moved = inverse(truth[i - 1]) @ truth[i]
        moved[:3, 3] *= 1.003
        moved[:3, :3] = moved[:3, :3] @ so3_exp(rng.normal(0, 2e-4, 3))
        T_new = T @ moved
        covariance = uncertainty.move(T, T_new, OWN + np.diag([0.0] * 3 + [4e-8] * 3))
        T = T_new
        if places is not None:
            found = constraint.correction(T, covariance, GnssPosition(places[i], 1.35), 0.1 * i)
            if found is not None:
                T = found.motion @ T
                uncertainty.correct(found.remaining)
        errors[i] = np.linalg.norm(T[:2, 3] - truth[i, :2, 3])
    return errors


@pytest.mark.parametrize("jumps", [False, True])
def test_fixes_bound_the_drift_of_a_long_drive(jumps: bool) -> None:
    rng = np.random.default_rng(3)
    truth = true_poses()
    alone = drive(truth, None, truth[0], (0.0, 0.0), np.random.default_rng(4))
    held = drive(truth, fixes(truth, rng, jumps), truth[0], (0.0, 0.0), np.random.default_rng(4))
    assert alone[-1] > 10.0
    assert held.max() < 4.5
    assert np.median(held) < 1.5


def test_a_start_by_the_first_fix_is_mended_in_place_and_heading() -> None:
    rng = np.random.default_rng(5)
    truth = true_poses()
    start = truth[0].copy()
    start[:3, 3] += [2.0, -1.5, 0.0]
    start[:3, :3] = so3_exp(np.array([0.0, 0.0, 0.05])) @ start[:3, :3]
    held = drive(truth, fixes(truth, rng, False), start, (1.35, 0.05), np.random.default_rng(6))
    assert held[2000:].max() < 3.5


def test_a_start_at_a_reflection_is_mended_once_the_fixes_agree_that_it_was_one() -> None:
    rng = np.random.default_rng(7)
    truth = true_poses()
    start = truth[0].copy()
    start[:3, 3] += [25.0, 0.0, 0.0]
    held = drive(truth, fixes(truth, rng, False), start, (1.35, 0.03), np.random.default_rng(8))
    assert held[250] > 15.0
    assert held[3000:].max() < 5.0


def test_a_fix_says_next_to_nothing_to_a_pose_that_is_sure() -> None:
    T = make_pose(heading_to_rotation(0.3), np.array([5.0, 6.0, 1.0]))
    found = GnssConstraint().correction(T, np.eye(6) * 1e-4, GnssPosition(T[:3, 3] + 1.5, 1.35), 0.0)
    assert found is not None
    assert np.abs(found.motion @ T - T).max() < 1e-4
