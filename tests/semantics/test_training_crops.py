"""What the bundled model is trained to say of a picture."""

import numpy as np
import pytest

from autowaze.world.labels import ClassLabel
from training.crops import CROP_H, CROP_W, IGNORED, crop, targets
from training.hardening import hardened
from training.rows import with_rows

LABELS = np.zeros(256, np.uint8)
LABELS[[1, 2, 3]] = ClassLabel.CAR, ClassLabel.TRUCK, ClassLabel.PERSON


def picture():
    """Two vehicles and a person, brighter than what lies around."""
    ids = np.zeros((375, 1242), np.uint8)
    ids[150:300, 300:620] = 1
    ids[180:320, 560:760] = 2
    ids[120:330, 640:690] = 3
    return np.where(ids > 0, 200, 60).astype(np.uint8), ids


def test_a_crop_moves_picture_and_ids_alike():
    rng = np.random.default_rng(3)
    for _ in range(20):
        image, ids = crop(*picture(), LABELS, rng)
        assert image.shape == ids.shape == (CROP_H, CROP_W)
        assert ((image > 130) == (ids > 0)).mean() > 0.985


def test_targets_are_boxes_of_what_is_visible():
    ids = np.zeros((CROP_H, CROP_W), np.uint8)
    ids[40:140, 100:300] = 1
    ids[60:160, 240:340] = 2
    ids[150, 20:24] = 3
    classes, boxes, weight, owner, bond = targets(ids, LABELS)
    assert classes[25, 75] == classes[40, 150] == 1  # cars and trucks are vehicles
    assert boxes[25, 75] == pytest.approx([100, 40, 300, 140])
    assert boxes[40, 150] == pytest.approx([240, 60, 340, 160])
    assert classes[75, 11] in (0, IGNORED)  # too small to be asked for
    assert weight[75, 11] == weight[0, 0] == 0
    assert weight[40, 150] > weight[25, 75] > 0  # the smaller instance's pixels weigh more
    assert (owner[25, 75], owner[40, 150]) == (1, 2)
    assert bond[40, 150] > bond[25, 75] > bond[75, 11] == 0


def test_hardening_may_hide_instances_but_never_moves_or_invents_them():
    rng = np.random.default_rng(4)
    for _ in range(60):
        image, ids = crop(*picture(), LABELS, rng)
        hard, hard_ids = hardened(image, ids, rng)
        assert hard.shape == image.shape and hard.dtype == np.uint8
        assert ((hard_ids == ids) | (hard_ids == 0)).all()


def test_votes_of_instances_whose_boxes_overlap_weigh_more():
    ids = np.zeros((CROP_H, CROP_W), np.uint8)
    ids[20:80, 20:80] = 1
    ids[20:80, 80:180] = 2
    beside = targets(ids, LABELS)[2]
    ids[10:20, 20:120] = 1  # now its box reaches over the other's
    overlapping = targets(ids, LABELS)[2]
    assert overlapping[20, 70] > 1.3 * beside[20, 70]


def test_rows_put_nearer_vehicles_before_farther_ones():
    rng = np.random.default_rng(6)
    host = np.zeros((CROP_H, CROP_W), np.uint8)
    host[60:120, 150:260] = 1
    other = np.zeros((CROP_H, CROP_W), np.uint8)
    other[50:130, 100:220] = 2
    grey = np.full((CROP_H, CROP_W), 90, np.uint8)
    for _ in range(20):
        image, ids, labels = with_rows(grey, host, LABELS, (grey, other, LABELS), rng)
        assert image.shape == ids.shape == (CROP_H, CROP_W)
        assert (labels[np.unique(ids)[1:]] > 0).all()
        below = np.flatnonzero(np.bincount(ids.ravel(), minlength=256)[2:]) + 2
        hidden = host[(host == 1) & np.isin(ids, below)]
        lowest = max((np.nonzero(ids == i)[0].max() for i in below), default=0)
        assert hidden.size == 0 or lowest >= np.nonzero(host)[0].max()
