"""Tracking scores on tracks whose mistakes are known."""

import numpy as np
import pytest

from autowaze.evaluation.tracking import TrackingScore, box_iou

BOXES = np.array([[0.0, 0.0, 10.0, 10.0], [50.0, 0.0, 60.0, 10.0]])


def score(*frames):
    scores = TrackingScore()
    for track_ids, rows in frames:
        scores.add(np.array([1, 2]), BOXES, np.array(track_ids), BOXES[rows])
    return scores.metrics()


def test_perfect_tracks():
    result = score(*[([7, 9], [0, 1])] * 10)
    assert (result["idf1"], result["id_switches"], result["mota"]) == (1.0, 0.0, 1.0)


def test_a_swap_of_two_ids_is_two_switches_and_half_the_identity():
    result = score(*[([7, 9], [0, 1])] * 5, *[([9, 7], [0, 1])] * 5)
    assert result["id_switches"] == 2.0
    assert result["idf1"] == pytest.approx(0.5)
    assert result["id_switches_per_object"] == 1.0


def test_a_missed_object_costs_recall():
    result = score(*[([7], [0])] * 10)
    assert result["recall"] == 0.5
    assert result["precision"] == 1.0


def test_iou_of_known_boxes():
    other = np.array([[5.0, 0.0, 15.0, 10.0], [0.0, 0.0, 10.0, 10.0]])
    assert box_iou(BOXES[:1], other)[0] == pytest.approx([1 / 3, 1.0])
    assert box_iou(np.zeros((0, 4)), other).shape == (0, 2)
