"""What counts when tracks and verdicts are scored, and what does not."""

from dataclasses import fields, replace

import numpy as np
import pytest

from autowaze.evaluation.object_tracking import ObjectTrackingScore, OracleBoxes
from autowaze.evaluation.segmentation import disjoint_masks
from autowaze.evaluation.true_instances import TrueInstances
from autowaze.vehicle.semantics.motion import Motions
from autowaze.world.instances import Detections, Tracks
from autowaze.world.labels import ClassLabel

LARGE, SMALL, CYCLIST = (10, 10, 50, 40), (60, 10, 66, 16), (70, 30, 90, 55)
BOXES = np.array([LARGE, SMALL, CYCLIST], np.float32)
LABELS = np.array([ClassLabel.CAR, ClassLabel.CAR, ClassLabel.TWO_WHEELER], np.uint8)


def masks():
    out = np.zeros((3, 60, 100), np.bool_)
    for mask, (x0, y0, x1, y1) in zip(out, BOXES.astype(int), strict=True):
        mask[y0:y1, x0:x1] = True
    return out


def truth(moving=False, range_m=10.0):
    m = masks()
    n = np.ones(3)
    return TrueInstances(np.array([4, 5, 6]), LABELS, BOXES, m, m.sum(axis=(1, 2)), n * range_m, n > 2 * (not moving))


def tracks(*rows, label=ClassLabel.CAR):
    rows = np.array(rows, int)
    labels = np.full(len(rows), label, np.uint8)
    return Tracks(rows.astype(np.int32) + 11, BOXES[rows], labels, np.ones(len(rows), np.float32), masks()[rows])


def concatenate_tracks(a, b):
    return Tracks(*(np.concatenate([getattr(a, f.name), getattr(b, f.name)]) for f in fields(Tracks)))


def verdict(moving):
    zero = np.zeros((1, 2), np.float32)
    return Motions(np.array([11], np.int32), np.array([1], np.uint8), np.array([moving]), zero, zero)


def test_small_vehicles_and_cyclists_count_neither_way():
    score = ObjectTrackingScore(iter(()), min_pixels=100)
    score.add(0.0, truth(), tracks(0, 1, 2), Motions.empty())
    score.add(0.1, truth(), tracks(0), Motions.empty())
    metrics = score.metrics()
    assert (metrics["objects"], metrics["precision"], metrics["recall"]) == (1.0, 1.0, 1.0)


def test_only_a_large_track_that_follows_nothing_is_a_false_alarm():
    precisions = []
    for row in (0, 1):
        score = ObjectTrackingScore(iter(()), min_pixels=100)
        astray = replace(tracks(row), id=np.array([99], np.int32), box=BOXES[[row]] + np.float32(45))
        score.add(0.0, truth(), concatenate_tracks(tracks(0), astray), Motions.empty())
        precisions.append(score.metrics()["precision"])
    assert precisions == [0.5, 1.0]


def test_verdicts_are_asked_for_after_a_second_near_by():
    score = ObjectTrackingScore(iter(()), min_pixels=100)
    for k in range(15):
        score.add(0.1 * k, truth(), tracks(0), verdict(k == 12))
    for k in range(15, 30):
        score.add(0.1 * k, truth(range_m=26.0), tracks(0), verdict(True))
    metrics = score.metrics()
    assert metrics["motion_verdicts"] == 5.0
    assert metrics["motion_right"] == metrics["parked_right"] == pytest.approx(0.8)
    assert "moving_right" not in metrics


def test_a_vehicle_that_no_track_follows_has_no_verdict():
    score = ObjectTrackingScore(iter(()), min_pixels=100)
    for k in range(15):
        score.add(0.1 * k, truth(moving=True), tracks(), Motions.empty())
    assert score.metrics()["motion_unjudged"] == 5.0
    assert score.metrics()["motion_verdicts"] == 0.0


def test_the_oracle_leaves_out_what_is_too_small():
    found = OracleBoxes(iter([truth()]), min_pixels=100).segment(np.zeros((60, 100), np.uint8))
    assert found.label.tolist() == [ClassLabel.CAR, ClassLabel.TWO_WHEELER]


def test_a_pixel_of_the_reference_has_one_owner():
    m = np.zeros((2, 4, 6), np.bool_)
    m[0, :, :4] = m[1, :, 2:] = True
    both = Detections(np.zeros((2, 4), np.float32), LABELS[:2], np.array([0.6, 0.9], np.float32), m)
    sure, other = disjoint_masks(both)
    assert (sure == m[1]).all()
    assert (other == (m[0] & ~m[1])).all()
