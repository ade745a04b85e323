"""Segmentation scores on masks whose overlap is known."""

import numpy as np
import pytest

from autowaze.evaluation.segmentation import score_frame, summarise
from autowaze.world.instances import Detections


def masks(*boxes):
    out = np.zeros((len(boxes), 60, 100), np.bool_)
    for mask, (x0, y0, x1, y1) in zip(out, boxes, strict=True):
        mask[y0:y1, x0:x1] = True
    return out


def found(*boxes, confidence=None):
    n = len(boxes)
    sure = np.full(n, 0.9) if confidence is None else np.array(confidence)
    return Detections(
        np.array(boxes, np.float32).reshape(n, 4), np.ones(n, np.uint8), sure.astype(np.float32), masks(*boxes)
    )


A, B, FAR = (10, 10, 30, 30), (30, 10, 50, 30), (70, 10, 90, 30)


def test_perfect_masks_score_one():
    scores = summarise([score_frame(found(A, FAR), masks(A, FAR))])
    assert (scores["precision"], scores["recall"], scores["ap50"]) == (1.0, 1.0, pytest.approx(1.0))


def test_one_detection_cannot_stand_for_two_cars():
    frame = score_frame(found((10, 10, 50, 30)), masks(A, B))
    scores = summarise([frame])
    assert scores["recall"] == 0.5
    assert (scores["touching_pairs"], scores["touching_separated"]) == (1.0, 0.0)
    assert summarise([score_frame(found(A, B), masks(A, B))])["touching_separated"] == 1.0


def test_two_cars_are_apart_when_each_has_a_detection_of_its_own_however_poor():
    sliver = (30, 10, 34, 30)
    scores = summarise([score_frame(found(A, sliver), masks(A, B))])
    assert (scores["touching_separated"], scores["touching_found"]) == (1.0, 0.0)
    unseen = summarise([score_frame(found(A), masks(A, B))])
    assert (unseen["touching_separated"], unseen["touching_found"]) == (0.0, 0.0)
    assert summarise([score_frame(found(), masks(A, B))])["touching_separated"] == 0.0


def test_what_is_found_twice_costs_precision():
    scores = summarise([score_frame(found(A, (11, 10, 30, 30)), masks(A))])
    assert (scores["precision"], scores["recall"]) == (0.5, 1.0)


def test_half_overlap_is_where_a_detection_starts_to_count():
    assert summarise([score_frame(found((10, 10, 30, 20)), masks(A))])["recall"] == 1.0
    assert summarise([score_frame(found((10, 10, 30, 19)), masks(A))])["recall"] == 0.0


def test_small_things_can_be_left_out():
    small = (60, 40, 65, 45)
    frame = score_frame(found(A, small), masks(A, FAR, small))
    assert summarise([frame], min_area=100) == summarise([score_frame(found(A), masks(A, FAR))], min_area=100)


def test_confident_mistakes_cost_more_average_precision():
    wrong = (40, 40, 60, 55)
    last = summarise([score_frame(found(A, FAR, wrong, confidence=[0.9, 0.8, 0.3]), masks(A, FAR))])
    first = summarise([score_frame(found(A, FAR, wrong, confidence=[0.6, 0.5, 0.9]), masks(A, FAR))])
    assert last["ap50"] == pytest.approx(1.0)
    assert first["ap50"] == pytest.approx(2 / 3)
    assert first["precision"] == last["precision"]


def test_empty_frames_are_no_mistake():
    nothing = Detections.empty(60, 100)
    scores = summarise([score_frame(nothing, masks()), score_frame(nothing, masks(A))])
    assert (scores["precision"], scores["recall"], scores["ap50"]) == (1.0, 0.0, 0.0)
