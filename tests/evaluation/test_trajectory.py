from __future__ import annotations

import numpy as np
import pytest

from autowaze.evaluation.trajectory import absolute_errors, align, relative_errors, trajectory_metrics
from autowaze.world.errors import AutowazeError
from autowaze.world.pose import make_pose, so3_exp


def _drive(n: int = 40) -> np.ndarray:
    headings = np.linspace(0.0, 1.0, n)
    steps = [make_pose(so3_exp(np.array([0.0, h / n, 0.0])), np.array([0.0, 0.0, 0.8])) for h in headings]
    poses = [np.eye(4)]
    for step in steps[1:]:
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def _disturbed(poses: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(3)
    noise = [make_pose(so3_exp(rng.normal(0, 0.01, 3)), rng.normal(0, 0.05, 3)) for _ in poses]
    moved = make_pose(so3_exp(np.array([0.3, -1.2, 0.4])), np.array([100.0, -20.0, 3.0]))
    return np.stack([moved @ pose @ n for pose, n in zip(poses, noise, strict=True)])


def test_equals_evo() -> None:
    from evo.core import metrics
    from evo.core.trajectory import PosePath3D

    truth = _drive()
    estimate = _disturbed(truth)
    reference, other = PosePath3D(poses_se3=list(truth)), PosePath3D(poses_se3=list(estimate))
    rpe = metrics.RPE(metrics.PoseRelation.translation_part, delta=1, delta_unit=metrics.Unit.frames, all_pairs=True)
    rpe.process_data((reference, other))
    other.align(reference)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((reference, other))

    assert absolute_errors(estimate, truth).rmse == pytest.approx(
        ape.get_statistic(metrics.StatisticsType.rmse), rel=1e-9
    )
    assert relative_errors(estimate, truth).mean == pytest.approx(
        rpe.get_statistic(metrics.StatisticsType.mean), rel=1e-9
    )


def test_a_drive_moved_as_a_whole_has_no_error() -> None:
    truth = _drive()
    moved = make_pose(so3_exp(np.array([0.1, 0.2, 3.0])), np.array([5.0, 6.0, 7.0])) @ truth
    assert absolute_errors(moved, truth).max < 1e-9
    assert relative_errors(moved, truth).max < 1e-9
    assert absolute_errors(moved, truth, aligned=False).max > 1.0


def test_drift_is_seen_from_the_first_pose() -> None:
    """A heading that is wrong from the start alone is none; a way that comes out a hundredth too long is a per cent."""
    truth = np.stack([make_pose(np.eye(3), np.array([0.0, 0.0, z])) for z in np.linspace(0.0, 50.0, 20)])
    longer = truth.copy()
    longer[:, 2, 3] *= 1.01
    turned = make_pose(so3_exp(np.array([0.0, 0.4, 0.0])), np.array([3.0, 0.0, 1.0]))
    assert trajectory_metrics(turned @ truth, truth)["drift_percent"] == pytest.approx(0.0, abs=1e-9)
    assert trajectory_metrics(turned @ longer, truth)["drift_percent"] == pytest.approx(1.0)


def test_alignment_never_mirrors() -> None:
    flat = _drive()[:, :3, 3]
    T = align(flat, flat * [1.0, 1.0, -1.0])
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_trajectories_of_different_length_are_refused() -> None:
    with pytest.raises(AutowazeError, match="same frames"):
        absolute_errors(_drive(10), _drive(11))
