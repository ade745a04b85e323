"""Tracking and motion on the labels of a real drive, held to the bars of the project."""

import numpy as np
import pytest

from autowaze.evaluation.tracking import TrackingScore
from autowaze.traces import open_trace
from autowaze.traces.kitti_labels import read_labels
from autowaze.vehicle.semantics.association import associate
from autowaze.vehicle.semantics.instance_depth import measure_depths
from autowaze.vehicle.semantics.motion import MotionClassifier
from autowaze.vehicle.semantics.sort import Sort
from autowaze.vehicle.semantics.sort_settings import SortSettings
from autowaze.vehicle.vision.extractor import FeatureExtractor
from autowaze.world.instances import Detections, Tracks
from autowaze.world.labels import ClassLabel, is_vehicle
from autowaze.world.pose import heading_to_rotation, make_pose

LABEL_OF_KIND = {
    "Car": ClassLabel.CAR,
    "Van": ClassLabel.CAR,
    "Cyclist": ClassLabel.TWO_WHEELER,
    "Pedestrian": ClassLabel.PERSON,
}
MOVING = {0, 1, 2, 4, 12}  # moving.json
T_MAP_WORLD = make_pose(heading_to_rotation(0.0), np.zeros(3))


@pytest.fixture(scope="module")
def drive(kitti):
    """Per frame: labels as detections, features, pose; of every frame, with truth."""
    trace = open_trace(kitti / "drive_0005", cameras="grey")
    extractor = FeatureExtractor(trace.camera)
    labels = read_labels(kitti / "drive_0005" / "label_02.txt")
    frames = []
    for k, frame in enumerate(trace):
        rows = labels[labels.frame == frame.index]
        frames.append((rows, as_detections(rows, frame.left.shape), extractor.extract(frame), pose(trace, k)))
    return trace, frames


def pose(trace, k):
    return T_MAP_WORLD @ trace.ground_truth.T_world_cam[k]


def as_detections(rows, shape):
    """Label boxes with a mask in their middle, where the thing itself is seen, less the boxes of nearer things."""
    masks = np.zeros((len(rows), *shape[:2]), np.bool_)
    for i in np.argsort(-rows.position_cam[:, 2]):
        x0, y0, x1, y1 = rows.box[i]
        dx, dy = 0.08 * (x1 - x0), 0.12 * (y1 - y0)
        masks[:, int(y0) : int(y1), int(x0) : int(x1)] = False
        masks[i, int(y0 + dy) : int(y1 - dy), int(x0 + dx) : int(x1 - dx)] = True
    label = np.array([LABEL_OF_KIND[kind] for kind in rows.kind], np.uint8)
    return Detections(rows.box.astype(np.float32), label, np.ones(len(rows), np.float32), masks)


def score(frames, sort, with_depth):
    scores = TrackingScore()
    for rows, detections, features, T_map_cam in frames:
        depths = measure_depths(features, detections) if with_depth else None
        tracks = sort.update(detections, T_map_cam if with_depth else None, depths)
        scores.add(rows.track_id, rows.box, tracks.id, tracks.box)
    return scores.metrics()


def test_ids_hold_on_the_labels_of_a_real_drive(drive):
    trace, frames = drive
    helped = score(frames, Sort(trace.camera), with_depth=True)
    plain = score(frames, Sort(settings=SortSettings(min_iou=0.3)), with_depth=False)
    assert helped["idf1"] >= 0.985
    assert plain["idf1"] >= 0.97
    assert helped["id_switches"] <= plain["id_switches"] / 2


def test_moving_and_parked_vehicles_are_told_apart(drive):
    trace, frames = drive
    classifier = MotionClassifier(trace.camera)
    seen: dict[int, int] = {}
    right = wrong = 0
    for k, (rows, d, features, T_map_cam) in enumerate(frames):
        tracks = Tracks(rows.track_id.astype(np.int32) + 1, d.box, d.label, d.confidence, d.mask)
        motions = classifier.update(associate(features, tracks), T_map_cam, 0.1 * k)
        distance = np.linalg.norm(rows.position_cam[:, [0, 2]], axis=1)
        for track in rows.track_id[(distance < 25.0) & is_vehicle(d.label)]:
            seen[track] = seen.get(track, 0) + 1
            judged = motions.moving[motions.id == track + 1]
            if seen[track] > 10 and len(judged):
                right += bool(judged[0]) == (track in MOVING)
                wrong += bool(judged[0]) != (track in MOVING)
    assert right >= 200
    assert right / (right + wrong) >= 0.97


def test_the_speed_of_the_van_ahead_is_known(drive):
    trace, frames = drive
    classifier = MotionClassifier(trace.camera)
    place, velocity = [], []
    for k, (rows, d, features, T_map_cam) in enumerate(frames[:30]):  # then it turns off
        tracks = Tracks(rows.track_id.astype(np.int32) + 1, d.box, d.label, d.confidence, d.mask)
        motions = classifier.update(associate(features, tracks), T_map_cam, 0.1 * k)
        place.append((T_map_cam @ np.append(rows.position_cam[rows.track_id == 0][0], 1.0))[:2])
        velocity.append(motions.velocity[motions.id == 1][0])
    true_velocity = (np.array(place[12:]) - np.array(place[7:-5])) / 0.5
    error = np.linalg.norm(np.array(velocity[12:]) - true_velocity, axis=1)
    assert np.median(error) <= 0.6
