from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_street import CAMERA, Street, drive, stored_map, straight_drive

from autowaze.vehicle.slam.settings import SlamSettings
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.feature_map import FeatureMap
from autowaze.world.features import CameraFeatures
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import heading_to_rotation, make_pose


@pytest.fixture(scope="module")
def street() -> Street:
    return Street()


@pytest.fixture(scope="module")
def base_map(street: Street) -> FeatureMap:
    slam = StereoSlam(CAMERA)
    drive(slam, street, straight_drive(60))
    return stored_map(slam)


def _errors_m(frames: list[TrackedFrame], poses: list[np.ndarray]) -> np.ndarray:
    return np.array([np.linalg.norm(f.T_map_cam[:3, 3] - T[:3, 3]) for f, T in zip(frames, poses, strict=True)])


def test_odometry_follows_a_straight_drive(street: Street) -> None:
    poses = straight_drive(60)
    frames = drive(StereoSlam(CAMERA), street, poses)
    assert {f.state for f in frames} == {TrackingState.ODOMETRY}
    assert {f.reason for f in frames} == {""}
    assert _errors_m(frames, poses)[-1] < 0.004 * 47.0


def test_two_runs_are_byte_identical(street: Street) -> None:
    def run() -> bytes:
        slam = StereoSlam(CAMERA)
        frames = drive(slam, street, straight_drive(25))
        parts = [f.T_map_cam.tobytes() + f.covariance.tobytes() + f.landmark_id.tobytes() for f in frames]
        return b"".join(parts) + slam.landmarks.position.tobytes()

    assert run() == run()


@pytest.mark.parametrize("prior", [(np.array([2.0, -2.0, 0.0]), 3.0), None])
def test_a_second_drive_in_another_lane_localises_at_once(
    street: Street, base_map: FeatureMap, prior: tuple[np.ndarray, float] | None
) -> None:
    poses = straight_drive(40, x_m=1.5)
    frames = drive(StereoSlam(CAMERA, stored_map=base_map, position_prior=prior), street, poses, seed=5000)
    assert {f.state for f in frames} == {TrackingState.LOCALIZED}
    assert np.median(_errors_m(frames, poses)) < 0.1


def test_stored_landmarks_stay_where_they_are(street: Street, base_map: FeatureMap) -> None:
    slam = StereoSlam(CAMERA, stored_map=base_map)
    drive(slam, street, straight_drive(20), seed=6000)
    np.testing.assert_array_equal(slam.landmarks.position[slam.landmarks.is_stored], base_map.features.position)


def test_odometry_bridges_the_end_of_the_map_and_says_so(street: Street, base_map: FeatureMap) -> None:
    half = FeatureMap(base_map.features[base_map.features.position[:, 1] < 40.0])
    poses = straight_drive(70)
    frames = drive(StereoSlam(CAMERA, stored_map=half), street, poses, seed=7000)
    assert frames[10].state == TrackingState.LOCALIZED
    assert frames[-1].state == TrackingState.ODOMETRY
    assert "stored map" in frames[-1].reason
    assert _errors_m(frames, poses).max() < 0.3


def test_a_camera_covered_for_a_minute_is_lost_at_once_and_found_again(street: Street, base_map: FeatureMap) -> None:
    poses = straight_drive(50)
    slam = StereoSlam(CAMERA, stored_map=base_map)
    before = [slam.track(street.see(T, 8000 + i), 0.1 * i, i) for i, T in enumerate(poses[:15])]
    covered = [slam.track(CameraFeatures.empty(), 0.1 * i, i) for i in range(15, 615)]
    after = [slam.track(street.see(T, 8000 + i), 60 + 0.1 * i, 600 + i) for i, T in enumerate(poses) if i >= 30]
    slam.finish()
    assert before[-1].state == TrackingState.LOCALIZED
    assert all(f.state == TrackingState.LOST and f.reason for f in covered)
    assert covered[14].covariance[0, 0] > 100.0
    assert {f.state for f in after[2:]} == {TrackingState.LOCALIZED}
    assert _errors_m(after[2:], poses[32:]).max() < 0.2


@pytest.mark.parametrize("turned_rad", [0.7, 1.6, 3.1])
def test_a_cut_to_another_direction_is_told_at_once_and_the_map_found_again(
    street: Street, base_map: FeatureMap, turned_rad: float
) -> None:
    """The camera turns on the spot to what the map does not know, for as long as odometry starts afresh there."""
    poses, elsewhere = straight_drive(60), Street(seed=77)
    slam, cut = StereoSlam(CAMERA, stored_map=base_map), range(15, 45)
    frames = []
    for i, T in enumerate(poses):
        turned = make_pose(heading_to_rotation(turned_rad), poses[15][:3, 3])
        features = elsewhere.see(turned, 8000 + i) if i in cut else street.see(T, 8000 + i)
        frames.append(slam.track(features, 0.1 * i, i))
    slam.finish()
    assert TrackingState.LOST in {frames[i].state for i in cut[:3]}
    assert not any(frames[i].state == TrackingState.LOCALIZED for i in cut)
    found = next(i for i in range(45, 60) if frames[i].state == TrackingState.LOCALIZED)
    assert found < 55
    assert _errors_m(frames[found:], poses[found:]).max() < 0.2


@pytest.mark.parametrize("n_cut", [8, 16])
def test_frames_cut_out_of_a_turn_do_not_bend_the_way(street: Street, n_cut: int) -> None:
    """The view jumps on by a turn on the spot: what was seen before places it, or it is said to be lost."""
    at = straight_drive(30)
    poses = at[:20] + [make_pose(heading_to_rotation(0.05 * k), at[20][:3, 3]) for k in range(30)]
    poses = poses[:22] + poses[22 + n_cut :]
    slam = StereoSlam(CAMERA)
    frames = [slam.track(street.see(T, 4000 + i), 0.1 * i, i) for i, T in enumerate(poses)]
    slam.finish()
    for frame, T in zip(frames, poses, strict=True):
        off_m = np.linalg.norm(frame.T_map_cam[:3, 3] - T[:3, 3])
        assert off_m < 0.3 or not frame.is_trustworthy or frame.covariance[0, 0] > 1.0


def test_the_pose_is_foretold_where_the_car_turns_all_at_once(street: Street) -> None:
    slam, poses = StereoSlam(CAMERA), straight_drive(23)
    for i in (1, 2, 3):
        poses[19 + i][:3, :3] = heading_to_rotation(np.radians(3.0 * i))
    for i, T in enumerate(poses):
        seen = street.see(T, 1000 + i)
        foretold = slam.foretell(seen)
        told = slam.track(seen, 0.1 * i, i).T_map_cam
        if foretold is None:
            assert i == 0
        else:
            assert np.linalg.norm(foretold[:3, 3] - told[:3, 3]) < 0.2
            assert foretold[:3, 2] @ told[:3, 2] > np.cos(np.radians(0.5))


def test_a_turn_that_ends_at_once_is_followed_among_fronts_that_look_alike() -> None:
    """Where the car would look had it turned on, each point has one like it: few of those agree on a motion."""
    street, poses, rng = Street(), straight_drive(30), np.random.default_rng(3)
    heading = np.radians([3.0 * min(max(i - 14, 0), 5) for i in range(30)])
    poses = [make_pose(heading_to_rotation(h), T[:3, 3]) for h, T in zip(heading, poses, strict=True)]
    ends = poses[20]
    away = (street.position - ends[:3, 3]) @ ends[:3, :3]
    turned, tilted = np.radians(rng.uniform(2.7, 3.3, len(away))), np.radians(rng.uniform(-0.3, 0.3, len(away)))
    x = away[:, 0] * np.cos(turned) - away[:, 2] * np.sin(turned)
    z = away[:, 0] * np.sin(turned) + away[:, 2] * np.cos(turned)
    alike = np.column_stack([x, away[:, 1] + np.hypot(x, z) * tilted, z]) @ ends[:3, :3].T + ends[:3, 3]
    street.position = np.vstack([street.position, alike])
    street.descriptor, street.label = np.tile(street.descriptor, (2, 1)), np.tile(street.label, 2)
    street.offset = np.zeros_like(street.position)
    slam = StereoSlam(CAMERA)
    drive(slam, street, poses[:20])
    foretold = slam.foretell(street.see(ends, 1020))
    assert foretold is not None
    assert foretold[:3, 2] @ ends[:3, 2] > np.cos(np.radians(0.5))
    frames = [slam.track(street.see(T, 1020 + i), 2.0 + 0.1 * i, i) for i, T in enumerate(poses[20:])]
    assert _errors_m(frames, poses[20:]).max() < 0.1


def test_foretelling_changes_nothing(street: Street) -> None:
    def run(*, foretells: bool) -> bytes:
        slam, poses = StereoSlam(CAMERA), b""
        for i, T in enumerate(straight_drive(15)):
            seen = street.see(T, 1000 + i)
            if foretells:
                slam.foretell(seen)
            poses += slam.track(seen, 0.1 * i, i).T_map_cam.tobytes()
        return poses

    assert run(foretells=True) == run(foretells=False)


def test_a_teleported_car_starts_odometry_afresh_and_admits_it(street: Street) -> None:
    slam = StereoSlam(CAMERA)
    drive(slam, street, straight_drive(10))
    elsewhere = Street(seed=77)
    frames = [slam.track(elsewhere.see(T, 9000 + i), 5.0 + 0.1 * i, i) for i, T in enumerate(straight_drive(20))]
    slam.finish()
    assert frames[0].state == TrackingState.LOST
    assert any("afresh" in f.reason for f in frames)
    assert frames[-1].state == TrackingState.ODOMETRY
    assert frames[-1].covariance[0, 0] > 1.0


def test_traffic_does_not_steer_the_pose(street: Street) -> None:
    """A third of the points belongs to cars that drive along with the camera."""
    traffic = Street()
    traffic.label[::3] = ClassLabel.CAR
    poses = straight_drive(30)
    slam = StereoSlam(CAMERA)
    frames = []
    for i, T in enumerate(poses):
        traffic.offset[::3, 1] = 0.7 * i
        frames.append(slam.track(traffic.see(T, 100 + i), 0.1 * i, i))
    slam.finish()
    assert _errors_m(frames, poses).max() < 0.15


def test_dirt_on_the_lens_does_not_stand_for_the_street() -> None:
    """A short baseline, long steps from the first frame on, look-alikes, specks seen at the same pixels for ever."""
    street = Street()
    street.descriptor = street.descriptor[np.random.default_rng(6).integers(0, 60, len(street.descriptor))]
    camera = replace(CAMERA, fx=528.0, fy=528.0, baseline_m=0.12)
    rng = np.random.default_rng(5)
    uv = rng.uniform([0, 0], [camera.width, camera.height], (150, 2))
    depth = rng.uniform(5.0, 30.0, 150)
    specks = CameraFeatures(
        uv=uv.astype(np.float32),
        octave=np.full(150, 3, np.uint8),
        angle=np.zeros(150, np.float32),
        descriptor=rng.integers(0, 256, (150, 32), dtype=np.uint8),
        u_right=(uv[:, 0] - camera.bf / depth).astype(np.float32),
        depth=depth.astype(np.float32),
        position_cam=camera.back_project(uv, depth).astype(np.float32),
        label=np.zeros(150, np.uint8),
        instance_id=np.zeros(150, np.int32),
    )
    poses = straight_drive(30, step_m=1.2)
    slam = StereoSlam(camera)
    frames = []
    for i, T in enumerate(poses):
        seen = street.see(T, 100 + i, 0.8, camera)
        frames.append(slam.track(CameraFeatures.concatenate([seen, specks]), 0.17 * i, i))
    slam.finish()
    assert _errors_m(frames, poses).max() < 0.035 * 35.0


def test_features_known_to_move_never_become_landmarks(street: Street) -> None:
    slam = StereoSlam(CAMERA)
    for i, T in enumerate(straight_drive(5)):
        features = street.see(T, i)
        moving = features.uv[:, 0] < 300
        frame = slam.track(features, 0.1 * i, i, moving=moving)
        assert (frame.landmark_id[moving] == -1).all()
    slam.finish()


def test_parked_cars_become_landmarks_with_label_and_instance(street: Street) -> None:
    parked = Street()
    parked.label[::4] = ClassLabel.CAR
    slam = StereoSlam(CAMERA)
    frames = drive(slam, parked, straight_drive(10))
    features = parked.see(straight_drive(10)[-1], 1000 + 9)
    on_car = (features.label == ClassLabel.CAR) & (frames[-1].landmark_id >= 0)
    assert on_car.sum() > 0.5 * (features.label == ClassLabel.CAR).sum()
    rows = slam.landmarks.rows(frames[-1].landmark_id[on_car])
    assert (slam.landmarks.label[rows] == ClassLabel.CAR).all()
    assert (slam.landmarks.instance[rows] == ClassLabel.CAR).all()


def test_too_few_features_do_not_start_a_drive() -> None:
    frame = StereoSlam(CAMERA).track(CameraFeatures.empty(), 0.0, 0)
    assert frame.state == TrackingState.INITIALIZING
    assert "0 stereo features" in frame.reason


def test_the_stated_covariance_covers_the_error_that_is_made(street: Street) -> None:
    """Squared position errors over stated variances; here points err independently, images do less kindly."""
    poses, normalised = straight_drive(40), []
    for seed in (11_000, 12_000, 13_000):
        frames = drive(StereoSlam(CAMERA), street, poses, seed=seed)
        for i in (10, 25, 39):
            error = frames[i].T_map_cam[:3, 3] - poses[i][:3, 3]
            normalised.append(error @ np.linalg.solve(frames[i].covariance[:3, :3], error) / 3)
    assert 0.1 < np.mean(normalised) < 1.5


def test_uncertainty_grows_once_the_stored_map_ends(street: Street, base_map: FeatureMap) -> None:
    half = FeatureMap(base_map.features[base_map.features.position[:, 1] < 40.0])
    frames = drive(StereoSlam(CAMERA, stored_map=half), street, straight_drive(70), seed=7000)
    sigma_m = [np.sqrt(np.trace(f.covariance[:3, :3])) for f in frames]
    ends = [f.state for f in frames].index(TrackingState.ODOMETRY)
    assert max(sigma_m[:ends]) < 0.1
    assert sigma_m[-1] > 2 * np.median(sigma_m[:ends])


def test_a_long_drive_takes_no_more_memory_than_a_short_one() -> None:
    """One street after another, ten minutes apart: what is out of sight is forgotten, ids go on."""
    slam, sizes = StereoSlam(CAMERA, SlamSettings(memory_s=3.0)), []
    for lap in range(8):
        street = Street(60.0, seed=lap)
        for i, T in enumerate(straight_drive(20)):
            slam.track(street.see(T, 100 * lap + i), 600.0 * lap + 0.1 * i, 20 * lap + i)
        sizes.append(len(slam.landmarks))
    slam.finish()
    ids = slam.landmarks.id
    assert sizes[-1] < 1.5 * sizes[0]
    assert slam.landmarks.capacity < 0.8 * ids[-1]
    np.testing.assert_array_equal(slam.landmarks.rows(ids), np.arange(len(ids)))
    assert (slam.landmarks.rows(np.array([-1, 0, 1, ids[-1] + 1])) == -1).all()


def test_a_long_drive_in_a_known_street_takes_no_more_memory(street: Street, base_map: FeatureMap) -> None:
    """To and fro between the same houses: nothing is left over of what was seen before."""
    slam, sizes = StereoSlam(CAMERA, SlamSettings(memory_s=3.0), stored_map=base_map), []
    poses = straight_drive(16)
    for lap in range(6):
        for i, T in enumerate(poses if lap % 2 == 0 else poses[::-1]):
            frame = slam.track(street.see(T, 16 * lap + i), 2.0 * lap + 0.1 * i, 16 * lap + i)
            assert frame.state == TrackingState.LOCALIZED
        sizes.append(len(slam.landmarks))
    slam.finish()
    assert sizes[-1] < 1.1 * sizes[1]


def test_a_car_put_down_elsewhere_in_the_map_is_lost_and_found_there(street: Street, base_map: FeatureMap) -> None:
    """As after a ferry or a tow: no pose in between is trusted as localised unless it is right."""
    poses = [*straight_drive(15), *straight_drive(25, start_m=28.0)]
    frames = drive(StereoSlam(CAMERA, stored_map=base_map), street, poses, seed=12_000)
    errors = _errors_m(frames, poses)
    wrong = [f.state for f, e in zip(frames, errors, strict=True) if e > 0.3]
    assert TrackingState.LOCALIZED not in wrong
    assert frames[25].state == TrackingState.LOCALIZED
    assert frames[15].reason or errors[15] < 0.3


def test_a_car_in_a_street_that_is_not_its_map_never_says_localised(base_map: FeatureMap) -> None:
    elsewhere = Street(seed=99)
    start = straight_drive(1)[0]
    slam = StereoSlam(CAMERA, stored_map=base_map, T_map_start=start)
    frames = drive(slam, elsewhere, straight_drive(30), seed=13_000)
    assert TrackingState.LOCALIZED not in {f.state for f in frames}
    assert all(f.reason for f in frames)
    assert all(f.covariance[0, 0] > 1.0 for f in frames)


def test_a_map_of_which_little_is_left_is_found_by_which_way_the_car_looks() -> None:
    """As on a car park, on another day: most points look like another one by now, and most matches are wrong."""
    changed, slam = Street(per_metre=60), StereoSlam(CAMERA)
    drive(slam, changed, straight_drive(25))
    known, rng = stored_map(slam), np.random.default_rng(0)
    other = rng.permutation(np.flatnonzero(rng.random(len(changed.position)) < 0.94))
    changed.descriptor[np.sort(other)] = changed.descriptor[other]
    for i, T in enumerate(straight_drive(5, start_m=8.0)):
        roughly = make_pose(heading_to_rotation(np.radians(3.0)), T[:3, 3] + [3.0, -2.0, 0.0])
        slam = StereoSlam(CAMERA, stored_map=known, T_map_start=roughly)
        found = slam.track(changed.see(T, 700 + i), 0.0, 0)
        slam.finish()
        assert found.state == TrackingState.LOCALIZED
        assert np.linalg.norm(found.T_map_cam[:3, 3] - T[:3, 3]) < 0.2


def test_a_car_outside_its_map_sets_out_at_once(street: Street, base_map: FeatureMap) -> None:
    far = straight_drive(20)
    for T in far:
        T[0, 3] += 500.0
    beside = Street()
    beside.position[:, 0] += 500.0
    frames = drive(StereoSlam(CAMERA, stored_map=base_map, T_map_start=far[0]), beside, far, seed=14_000)
    assert {f.state for f in frames} == {TrackingState.ODOMETRY}
    assert all("stored map" in f.reason for f in frames)
    assert _errors_m(frames, far).max() < 0.2


def test_a_place_that_few_features_tell_wrongly_gives_way_to_the_one_that_more_agree_with(
    street: Street, base_map: FeatureMap
) -> None:
    """House fronts far ahead that were mapped two metres off are all that the first frame shows."""
    poses = straight_drive(12)
    features = base_map.features
    far = np.abs(features.position[:, 1] - 38.0) < 6.0
    off = replace(features, position=features.position + far[:, None] * np.array([2.0, 0.0, 0.0]))
    hidden = Street()
    hidden.position[np.abs(hidden.position[:, 1] - 38.0) > 6.0, 1] += 1000.0
    slam = StereoSlam(CAMERA, stored_map=FeatureMap(off))
    frames = [slam.track((street if i else hidden).see(T, 15_000 + i), 0.1 * i, i) for i, T in enumerate(poses)]
    slam.finish()
    errors = _errors_m(frames, poses)
    assert frames[0].state is TrackingState.LOCALIZED
    assert errors[0] > 1.0
    assert errors[2:].max() < 0.1
