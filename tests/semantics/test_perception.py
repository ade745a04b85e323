"""Segmentation and tracking together, and masks carried between frames."""

import cv2
import numpy as np
import pytest

from autowaze.traces import open_trace
from autowaze.vehicle.semantics.perception import SemanticPerception
from autowaze.vehicle.semantics.propagation import propagate
from autowaze.vehicle.semantics.segmenter import load_segmenter
from autowaze.world.frame import StereoFrame
from autowaze.world.instances import Detections
from autowaze.world.labels import ClassLabel

HEIGHT, WIDTH = 200, 400


def textured(seed=0):
    rng = np.random.default_rng(seed)
    layers = [cv2.GaussianBlur(rng.normal(size=(HEIGHT, WIDTH)), (0, 0), s) * s for s in (1.5, 4.0, 12.0)]
    return np.clip(128 + 40 * sum(layers), 0, 255).astype(np.uint8)


def one_car(x0=100, y0=60, x1=180, y1=120):
    mask = np.zeros((1, HEIGHT, WIDTH), np.bool_)
    mask[0, y0:y1, x0:x1] = True
    return Detections(
        np.array([[x0, y0, x1, y1]], np.float32),
        np.array([ClassLabel.CAR], np.uint8),
        np.array([0.9], np.float32),
        mask,
    )


def warped(image, scale, dx, dy):
    return cv2.warpAffine(
        image, np.array([[scale, 0, dx], [0, scale, dy]]), (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT
    )


class CountingSegmenter:
    """Finds the same car in every image and counts how often it is asked."""

    name = "counting"

    def __init__(self):
        self.calls = 0

    def segment(self, image):
        self.calls += 1
        return one_car()


@pytest.mark.parametrize(("scale", "dx", "dy"), [(1.0, 12.0, -3.0), (1.06, -8.0, -5.0), (0.95, 9.0, 4.0)])
def test_a_mask_follows_its_object(scale, dx, dy):
    before = textured()
    moved = propagate(one_car(), before, warped(before, scale, dx, dy))
    expected = np.array([100, 60, 180, 120]) * scale + [dx, dy, dx, dy]
    assert moved.box[0] == pytest.approx(expected, abs=1.5)
    rows, columns = np.nonzero(moved.mask[0])
    assert [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1] == pytest.approx(expected, abs=2.0)
    assert moved.label.tolist() == [ClassLabel.CAR]
    assert moved.confidence[0] < 0.9


def test_an_object_that_cannot_be_followed_is_dropped():
    flat = np.full((HEIGHT, WIDTH), 90, np.uint8)
    assert len(propagate(one_car(), flat, flat)) == 0
    assert len(propagate(one_car(), textured(0), textured(1))) == 0


def test_an_object_that_leaves_the_image_is_cut_then_dropped():
    before = textured()
    cut = propagate(one_car(20, 60, 100, 120), before, warped(before, 1.0, -28.0, 0.0))
    assert cut.box[0, 0] == 0.0
    assert cut.box[0, 2] == pytest.approx(72.0, abs=1.5)


def test_every_nth_frame_is_segmented_and_ids_hold_between():
    image, segmenter = textured(), CountingSegmenter()
    perception = SemanticPerception(segmenter, every_nth=3)
    tracks = [perception.process(StereoFrame(k, 0.1 * k, image, image)) for k in range(7)]
    assert segmenter.calls == 3
    assert [t.id.tolist() for t in tracks] == [[1]] * 7


def test_the_same_drive_gives_the_same_tracks_bit_for_bit(kitti, yolo_weights):
    trace = open_trace(kitti / "drive_0005", cameras="grey", frames=slice(120, 126))
    runs = []
    for cv_threads in (1, 2):
        cv2.setNumThreads(cv_threads)
        perception = SemanticPerception(load_segmenter(yolo_weights, long_side=640), every_nth=2)
        runs.append([perception.process(frame) for frame in trace])
    cv2.setNumThreads(-1)
    for one, other in zip(*runs, strict=True):
        for column in ("id", "box", "label", "confidence", "mask"):
            assert np.array_equal(getattr(one, column), getattr(other, column))


def test_real_parked_cars_are_found_in_grey_images(kitti, yolo_weights):
    frame = open_trace(kitti / "drive_0005", cameras="grey", frames=slice(125, 126))[0]
    found = load_segmenter(yolo_weights).segment(frame.left)
    assert (found.label == ClassLabel.CAR).sum() >= 6
    assert (found.label == ClassLabel.PERSON).sum() == 1
    assert found.mask.shape == (len(found), 375, 1242)
    for mask, box in zip(found.mask, found.box, strict=True):
        rows, columns = np.nonzero(mask)
        assert box[0] - 1 <= columns.min() <= columns.max() <= box[2] + 1
        assert box[1] - 1 <= rows.min() <= rows.max() <= box[3] + 1
        assert mask.sum() > 0.4 * (box[2] - box[0]) * (box[3] - box[1])


def test_openvino_finds_what_onnxruntime_finds(kitti, test_data, yolo_weights):
    frame = open_trace(kitti / "drive_0005", cameras="grey", frames=slice(125, 126))[0]
    small = load_segmenter(test_data / "weights" / "yolov8n-seg_int8_openvino.xml").segment(frame.left)
    full = load_segmenter(yolo_weights).segment(frame.left)
    sure = full[full.confidence > 0.55]
    overlap = (sure.mask[:, None] & small.mask[None]).sum(axis=(2, 3)) / (sure.mask[:, None] | small.mask[None]).sum(
        axis=(2, 3)
    )
    assert (overlap.max(axis=1) > 0.8).all()
