"""Round a block and on over its beginning, and what is known of the way thereafter."""

from __future__ import annotations

from functools import cache

import numpy as np
from known_street import CAMERA, Street
from scipy.spatial import cKDTree

from autowaze.evaluation.drive import DriveRecord
from autowaze.evaluation.loop_correction import correct_loops
from autowaze.evaluation.trajectory import absolute_errors
from autowaze.vehicle.slam.loops.correction import DriveCorrection
from autowaze.vehicle.slam.loops.recognition import PlaceIndex
from autowaze.vehicle.slam.slam import StereoSlam
from autowaze.vehicle.slam.tracked_frame import TrackedFrame, TrackingState
from autowaze.world.feature_map import MapFeatures
from autowaze.world.identity import feature_ids
from autowaze.world.labels import ClassLabel
from autowaze.world.map_diff import SemanticMapDiff
from autowaze.world.pose import heading_to_rotation, inverse, make_pose, transform
from autowaze.world.wire import decode_diff

RADIUS_M, STEP_M, OVERLAP_M = 16.0, 1.2, 22.0
ROUND_M = 2 * np.pi * RADIUS_M


class Ring(Street):
    """House fronts on both sides of a road that leads back to where it began."""

    def __init__(self) -> None:
        super().__init__(ROUND_M, seed=5)
        x, along, z = self.position.T
        angle, radius = along / RADIUS_M, RADIUS_M + x
        self.position = np.column_stack([-radius * np.cos(angle), radius * np.sin(angle), z])


def _poses() -> list[np.ndarray]:
    angles = np.arange(0.0, ROUND_M + OVERLAP_M, STEP_M) / RADIUS_M
    return [make_pose(heading_to_rotation(a), RADIUS_M * np.array([-np.cos(a), np.sin(a), 0.0])) for a in angles]


def _driven(label: ClassLabel = ClassLabel.BACKGROUND) -> tuple[StereoSlam, list[TrackedFrame], np.ndarray]:
    """The drive, and its true poses; a tenth of a per cent is wrong with the rig's calibration."""
    ring, poses = Ring(), _poses()
    ring.label[:] = label
    slam, frames = StereoSlam(CAMERA), []
    for i, T in enumerate(poses):
        features = ring.see(T, 100 + i)
        features.u_right += np.float32(0.05)
        features.depth = (CAMERA.bf / (features.uv[:, 0] - features.u_right)).astype(np.float32)
        features.position_cam = CAMERA.back_project(features.uv, features.depth).astype(np.float32)
        frames.append(slam.track(features, 0.1 * i, i))
    slam.finish()
    return slam, frames, np.stack(poses)


@cache
def _round() -> tuple[StereoSlam, list[TrackedFrame], np.ndarray]:
    return _driven()


def _told(frames: list[TrackedFrame]) -> np.ndarray:
    return np.stack([f.T_map_cam for f in frames])


def test_a_drive_round_a_block_closes_its_loop() -> None:
    slam, frames, truth = _round()
    assert slam.loops.closings
    assert all(f.state is TrackingState.ODOMETRY for f in frames)
    for loop in slam.loops.loops:
        earlier, later = (truth[slam.loops.places[k].index - 1, :3, 3] for k in (loop.earlier, loop.later))
        assert np.linalg.norm(earlier - later) < 15.0
    slam.loops.adjust()
    told = absolute_errors(_told(frames)[: slam.loops.closings[0] - 1], truth[: slam.loops.closings[0] - 1])
    known = absolute_errors(DriveCorrection(slam.loops, _told(frames)).poses(), truth)
    assert known.rmse < told.rmse
    assert known.rmse < 0.1


def test_closing_a_loop_makes_the_pose_certain_again() -> None:
    slam, frames, _ = _round()
    closed = slam.loops.closings[0] - 1
    sigma_m = [np.sqrt(np.trace(f.covariance[:3, :3])) for f in frames]
    assert sigma_m[closed] < 0.5 * sigma_m[closed - 1]


def test_the_same_drive_closes_its_loop_in_the_same_way() -> None:
    (one, frames_one, _), (two, frames_two, _) = _round(), _driven()
    assert one.loops.closings == two.loops.closings
    assert _told(frames_one).tobytes() == _told(frames_two).tobytes()


def test_a_survey_is_moved_to_where_its_loops_put_it_and_tells_a_corner_once() -> None:
    slam, frames, truth = _round()
    told, ring = _told(frames), Ring()
    to_map = told[0] @ inverse(truth[0])
    record = DriveRecord(tracked=frames)
    for window in (range(0, 12), range(40, 50), range(len(frames) - 8, len(frames))):
        last = window[-1]
        near = np.linalg.norm(ring.position - truth[last, :3, 3], axis=1) < 14.0
        seen = transform(told[last] @ inverse(truth[last]), ring.position[near])
        record.diffs.append(_diff(len(record.diffs), frames[window[0]], frames[last], seen, ring.descriptor[near]))
        record.messages.append(b"")
    first, middle, again = (diff.new for diff in record.diffs)
    correct_loops(record, slam.loops)

    def off_m(new: MapFeatures) -> float:
        true = transform(to_map, ring.position)
        return float(np.median(cKDTree(true).query(new.position)[0]))

    assert len(record.diffs[0].new) == len(first)
    assert len(record.diffs[2].new) < 0.5 * len(again)
    assert off_m(record.diffs[1].new) < 0.6 * off_m(middle)
    assert len(decode_diff(record.messages[1]).new) == len(middle)


def _diff(
    sequence: int, begin: TrackedFrame, end: TrackedFrame, position: np.ndarray, descriptor: np.ndarray
) -> SemanticMapDiff:
    n = len(position)
    new = MapFeatures(
        id=feature_ids(1, sequence, n),
        position=position,
        descriptor=descriptor,
        normal=np.tile(np.array([0.0, -1.0, 0.0], np.float32), (n, 1)),
        min_distance=np.full(n, 2.0, np.float32),
        max_distance=np.full(n, 40.0, np.float32),
        label=np.zeros(n, np.uint8),
        instance_key=np.zeros(n, np.uint64),
        first_seen=np.full(n, begin.timestamp),
        last_seen=np.full(n, end.timestamp),
        observations=np.full(n, 5, np.uint16),
    )
    return SemanticMapDiff(1, sequence, begin.timestamp, end.timestamp, new=new)


def test_places_full_of_cars_are_no_loop() -> None:
    """What may drive away says nothing of where one is."""
    slam, _, _ = _driven(ClassLabel.CAR)
    assert slam.loops.loops == []


def test_a_place_is_most_like_itself_seen_again() -> None:
    rng, index = np.random.default_rng(3), PlaceIndex()
    places = [rng.integers(0, 256, (400, 32), dtype=np.uint8) for _ in range(20)]
    for descriptor in places:
        index.add(descriptor)
    flipped = np.packbits(rng.random((200, 256)) < 0.06, axis=1)
    index.add(np.concatenate([places[7][:200] ^ flipped, rng.integers(0, 256, (200, 32), dtype=np.uint8)]))
    likeness = index.likeness(20, np.arange(20))
    assert np.argmax(likeness) == 7
    assert likeness[7] > 5 * np.delete(likeness, 7).max()
    index.forget(7)
    assert index.likeness(20, np.array([7]))[0] == 0.0
