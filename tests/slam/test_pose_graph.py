from __future__ import annotations

import numpy as np

from autowaze.vehicle.slam.loops.pose_graph import RelativePoses, optimize_graph
from autowaze.world.pose import heading_to_rotation, inverse, make_pose, so3_exp

N = 24
SIGMAS = np.array([0.02] * 3 + [0.002] * 3)


def _ring() -> np.ndarray:
    turns = 2 * np.pi * np.arange(N) / N
    return np.stack([make_pose(heading_to_rotation(a), 10 * np.array([-np.cos(a), np.sin(a), 0.0])) for a in turns])


def _known(T: np.ndarray, noise: float = 1.0) -> RelativePoses:
    """Odometry round the ring, and two loops that close it."""
    rng = np.random.default_rng(0)
    a, b = np.append(np.arange(N - 1), [0, 1]), np.append(np.arange(1, N), [N - 1, N - 1])
    measured = inverse(T[a]) @ T[b]
    for i in range(len(a)):
        error = noise * rng.normal(0, SIGMAS)
        measured[i] = measured[i] @ make_pose(so3_exp(error[3:]), error[:3])
    covariance = np.tile(np.diag(SIGMAS**2), (len(a), 1, 1))
    return RelativePoses(a, b, measured, covariance, np.arange(len(a)) >= N - 1)


def _chained(known: RelativePoses, first: np.ndarray) -> np.ndarray:
    T = [first]
    for step in known.T_a_b[: N - 1]:
        T.append(T[-1] @ step)
    return np.stack(T)


def test_equals_gtsam() -> None:
    import gtsam

    truth = _ring()
    known = _known(truth)
    start = _chained(known, truth[0])
    solution = optimize_graph(start, known)

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.roll(SIGMAS, 3))  # gtsam has rotations first
    graph.add(gtsam.NonlinearEqualityPose3(0, gtsam.Pose3(truth[0])))
    for k, T in enumerate(start):
        values.insert(k, gtsam.Pose3(T))
    for a, b, T in zip(known.a, known.b, known.T_a_b, strict=True):
        graph.add(gtsam.BetweenFactorPose3(int(a), int(b), gtsam.Pose3(T), noise))
    oracle = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    expected = np.stack([oracle.atPose3(k).matrix() for k in range(N)])

    np.testing.assert_allclose(solution.T_map_cam, expected, atol=1e-3)
    before, after = (np.linalg.norm(T[:, :3, 3] - truth[:, :3, 3], axis=1).max() for T in (start, solution.T_map_cam))
    assert after < 0.5 * before
    assert 0.0 < np.sqrt(solution.covariance[0, 0]) < 0.05


def test_a_wrong_loop_bends_the_drive_little() -> None:
    truth = _ring()
    known = _known(truth, noise=0.0)
    wrong = inverse(truth[0]) @ truth[12]
    wrong[:3, 3] += [3.0, 0.0, 0.0]
    covariance = np.diag(SIGMAS**2)[None]
    bent = []
    for robust in (True, False):
        lie = RelativePoses(np.array([0]), np.array([12]), wrong[None], covariance, np.array([robust]))
        T = optimize_graph(truth, RelativePoses.concatenate([known, lie])).T_map_cam
        bent.append(np.linalg.norm(T[:, :3, 3] - truth[:, :3, 3], axis=1).max())
    assert bent[0] < 0.5 * bent[1]
