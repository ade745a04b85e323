from __future__ import annotations

import numpy as np
from known_street import CAMERA

from autowaze.vehicle.slam.bundle_adjustment import BundleProblem, adjust
from autowaze.vehicle.slam.pose_optimization import optimize_pose
from autowaze.world.pose import inverse, make_pose, so3_exp

K, P = 5, 120
SIGMA_PX, SIGMA_DISPARITY_PX = 0.5, 0.25


def _truth() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    T = np.stack([make_pose(so3_exp(rng.normal(0, 0.01, 3)), np.array([0.0, 0.0, 0.8 * k])) for k in range(K)])
    return T, np.column_stack([rng.uniform(-6, 6, P), rng.uniform(-2, 1.5, P), rng.uniform(12, 30, P)])


def _observe(T: np.ndarray, X: np.ndarray) -> np.ndarray:
    T_cam = inverse(T)
    pixel = CAMERA.project(X @ T_cam[:3, :3].T + T_cam[:3, 3])
    return np.column_stack([pixel[:, 0], pixel[:, 1], pixel[:, 0] - pixel[:, 2]])


def _problem() -> BundleProblem:
    rng = np.random.default_rng(1)
    T, X = _truth()
    measured = np.concatenate([_observe(Tk, X) for Tk in T])
    measured += rng.normal(0, 1, measured.shape) * [SIGMA_PX, SIGMA_PX, SIGMA_DISPARITY_PX]
    start = T.copy()
    for k in range(1, K):
        start[k] = T[k] @ make_pose(so3_exp(rng.normal(0, 0.003, 3)), rng.normal(0, 0.05, 3))
    return BundleProblem(
        T_map_cam=start,
        pose_free=np.arange(K) > 0,
        position=X + rng.normal(0, 0.1, X.shape),
        point_free=np.ones(P, np.bool_),
        keyframe=np.repeat(np.arange(K), P),
        point=np.tile(np.arange(P), K),
        measured=measured,
        information=np.tile([SIGMA_PX**-2, SIGMA_DISPARITY_PX**-2], (K * P, 1)),
        weight=np.ones(K * P),
    )


def test_equals_gtsam() -> None:
    import gtsam

    problem = _problem()
    solution = adjust(problem, CAMERA)

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    calibration = gtsam.Cal3_S2Stereo(CAMERA.fx, CAMERA.fy, 0.0, CAMERA.cx, CAMERA.cy, CAMERA.baseline_m)
    u, d = SIGMA_PX**2, SIGMA_DISPARITY_PX**2
    covariance = np.array([[u, u, 0], [u, u + d, 0], [0, 0, u]])  # of u, u_right = u - disparity, v
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    for k, T in enumerate(problem.T_map_cam):
        values.insert(gtsam.symbol("x", k), gtsam.Pose3(T))
    for p, X in enumerate(problem.position):
        values.insert(gtsam.symbol("l", p), X)
    graph.add(gtsam.NonlinearEqualityPose3(gtsam.symbol("x", 0), gtsam.Pose3(problem.T_map_cam[0])))
    for i in np.flatnonzero(solution.inlier):
        z = problem.measured[i]
        point = gtsam.StereoPoint2(z[0], z[0] - z[2], z[1])
        x, landmark = gtsam.symbol("x", int(problem.keyframe[i])), gtsam.symbol("l", int(problem.point[i]))
        graph.add(gtsam.GenericStereoFactor3D(point, noise, x, landmark, calibration))
    oracle = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()

    poses = np.stack([oracle.atPose3(gtsam.symbol("x", k)).matrix() for k in range(K)])
    np.testing.assert_allclose(solution.T_map_cam, poses, atol=2e-3)


def test_wrong_matches_are_told_apart() -> None:
    problem = _problem()
    rng = np.random.default_rng(2)
    wrong = rng.random(K * P) < 0.1
    problem.measured[wrong] += rng.choice([-1, 1], (wrong.sum(), 3)) * rng.uniform(10, 40, (wrong.sum(), 3))
    solution = adjust(problem, CAMERA)
    assert not solution.inlier[wrong].any()
    assert solution.inlier[~wrong].mean() > 0.9
    np.testing.assert_allclose(solution.T_map_cam, _truth()[0], atol=0.02)


def test_held_points_and_poses_stay() -> None:
    problem = _problem()
    problem.point_free[:60] = False
    solution = adjust(problem, CAMERA)
    np.testing.assert_array_equal(solution.position[:60], problem.position[:60])
    np.testing.assert_allclose(solution.T_map_cam[0], problem.T_map_cam[0], atol=1e-12)


def test_pose_from_held_landmarks() -> None:
    T, X = _truth()
    rng = np.random.default_rng(4)
    measured = _observe(T[3], X) + rng.normal(0, 1, (P, 3)) * [SIGMA_PX, SIGMA_PX, SIGMA_DISPARITY_PX]
    measured[:20] += 30.0
    information = np.tile([SIGMA_PX**-2, SIGMA_DISPARITY_PX**-2], (P, 1))
    estimate = optimize_pose(T[2], X, measured, information, np.ones(P), CAMERA)
    error = estimate.T_map_cam[:3, 3] - T[3, :3, 3]
    assert not estimate.inlier[:20].any()
    assert (np.abs(error) < 4 * np.sqrt(np.diag(estimate.covariance)[:3])).all()


def test_a_landmark_of_unknown_depth_tells_direction_only() -> None:
    T, X = _truth()
    information = np.tile([SIGMA_PX**-2, 0.0], (P, 1))
    ray = X / np.linalg.norm(X, axis=1, keepdims=True)
    measured = _observe(T[1], X)
    known = optimize_pose(T[1], X, measured, information, np.ones(P), CAMERA)
    vague = optimize_pose(T[1], X, measured, information, np.ones(P), CAMERA, depth_error=2.0 * ray)
    assert vague.covariance[2, 2] > 2 * known.covariance[2, 2]
    assert (vague.covariance.diagonal()[3:] < 4 * known.covariance.diagonal()[3:]).all()
