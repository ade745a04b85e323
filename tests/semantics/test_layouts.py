"""Every known export layout, on graphs whose detections are known."""

import json

import numpy as np
import pytest
from graphs import constant_network

from autowaze.vehicle.semantics.segmenter import load_segmenter
from autowaze.world.errors import ModelError
from autowaze.world.labels import ClassLabel

IMAGE = np.zeros((240, 320, 3), np.uint8)
COCO_PERSON, COCO_CAR, COCO_TRUCK = 0, 2, 7


def yolo_rows(anchors, n_classes=80, n_prototypes=2):
    """Output of anchors (cx, cy, w, h, class, score, coefficients)."""
    rows = np.zeros((1, 4 + n_classes + n_prototypes, len(anchors)), np.float32)
    for i, (cx, cy, w, h, number, score, coefficients) in enumerate(anchors):
        rows[0, :4, i] = cx, cy, w, h
        rows[0, 4 + number, i] = score
        rows[0, 4 + n_classes :, i] = coefficients
    return rows


def left_and_right_half(height, width):
    """Prototypes that are positive in the left half and in the right half of the image."""
    prototypes = np.full((1, 2, height, width), -4.0, np.float32)
    prototypes[0, 0, :, : width // 2] = 4.0
    prototypes[0, 1, :, width // 2 :] = 4.0
    return prototypes


@pytest.fixture
def yolo(tmp_path):
    anchors = [
        (160, 128, 100, 80, COCO_CAR, 0.9, (1, 0)),
        (162, 128, 100, 80, COCO_TRUCK, 0.8, (1, 0)),  # the same car, called a truck
        (40, 60, 20, 40, COCO_PERSON, 0.7, (1, 1)),
        (240, 60, 60, 40, COCO_CAR, 0.2, (0, 1)),  # not confident
        (240, 200, 60, 40, 56, 0.9, (0, 1)),  # a chair
    ]
    outputs = {"output0": yolo_rows(anchors), "output1": left_and_right_half(64, 80)}
    return constant_network(tmp_path / "yolo.onnx", [1, 3, "height", "width"], outputs, free={"output0", "output1"})


def test_yolo_seg_gives_boxes_labels_and_masks_at_image_size(yolo):
    found = load_segmenter(yolo).segment(IMAGE)
    assert found.label.tolist() == [ClassLabel.CAR, ClassLabel.PERSON]
    assert found.confidence == pytest.approx([0.9, 0.7])
    # 320 x 240 sits in a 320 x 256 input, eight rows down.
    assert found.box[0] == pytest.approx([110, 80, 210, 160])
    assert found.mask.shape == (2, 240, 320)
    rows, columns = np.nonzero(found.mask[0])
    assert (rows.min(), rows.max(), columns.min()) == (80, 159, 110)
    assert columns.max() == pytest.approx(159, abs=2)  # the left half of the image


def test_grey_and_colour_images_give_the_same(yolo):
    segmenter = load_segmenter(yolo)
    grey, colour = segmenter.segment(IMAGE[:, :, 0]), segmenter.segment(IMAGE)
    assert np.array_equal(grey.mask, colour.mask)


def test_confidence_is_what_the_caller_asks_for(yolo):
    assert len(load_segmenter(yolo, min_confidence=0.1).segment(IMAGE)) == 3
    assert len(load_segmenter(yolo, min_confidence=0.95).segment(IMAGE)) == 0


def test_class_names_come_from_the_model_or_from_the_file_beside_it(tmp_path):
    outputs = {
        "output0": yolo_rows([(160, 128, 100, 80, 1, 0.9, (1, 0))], n_classes=3),
        "output1": left_and_right_half(64, 80),
    }
    names = {"names": "{0: 'tree', 1: 'van', 2: 'pedestrian'}"}
    path = constant_network(tmp_path / "own.onnx", [1, 3, 256, 320], outputs, names)
    assert load_segmenter(path).segment(IMAGE).label.tolist() == [ClassLabel.CAR]
    path.with_suffix(".json").write_text(json.dumps({"class_names": {1: "bus"}}))
    assert load_segmenter(path).segment(IMAGE).label.tolist() == [ClassLabel.BUS]


def test_torchvision_masks_lie_over_the_image(tmp_path):
    masks = np.zeros((2, 1, 240, 320), np.float32)
    masks[0, 0, 60:100, 40:120] = 0.9
    outputs = {
        "boxes": np.array([[40, 60, 120, 100], [10, 10, 20, 20]], np.float32),
        "labels": np.array([3, 1], np.int64),  # COCO category ids: car, person
        "scores": np.array([0.95, 0.3], np.float32),
        "masks": masks,
    }
    path = constant_network(tmp_path / "tv.onnx", [1, 3, "h", "w"], outputs, free=set(outputs))
    found = load_segmenter(path).segment(IMAGE)
    assert found.label.tolist() == [ClassLabel.CAR]
    assert found.box[0] == pytest.approx([40, 60, 120, 100])
    assert np.array_equal(found.mask[0], masks[0, 0] > 0.5)


def test_detectron2_masks_lie_over_the_box_of_the_enlarged_image(tmp_path):
    scale = 800 / 240
    mask = np.zeros((1, 1, 28, 28), np.float32)
    mask[0, 0, :, :14] = 1.0
    outputs = {  # by field name, as the tracing export has them
        "pred_boxes": (np.array([[40, 60, 120, 100]]) * scale).astype(np.float32),
        "pred_classes": np.array([COCO_CAR], np.int64),
        "pred_masks": mask,
        "scores": np.array([0.95], np.float32),
        "image_size": np.array([800, 1067], np.int64),
    }
    path = constant_network(tmp_path / "d2.onnx", [3, "h", "w"], outputs)
    found = load_segmenter(path).segment(IMAGE)
    assert found.label.tolist() == [ClassLabel.CAR]
    assert found.box[0] == pytest.approx([40, 60, 120, 100], abs=0.1)
    rows, columns = np.nonzero(found.mask[0])
    assert (rows.min(), rows.max(), columns.min()) == (60, 99, 40)
    assert columns.max() == pytest.approx(79, abs=2)


def test_the_model_zoo_layout_is_stated_and_counts_classes_from_one(tmp_path):
    outputs = {
        "boxes": np.array([[40, 60, 120, 100]], np.float32) * 800 / 240,
        "labels": np.array([COCO_CAR + 1], np.int64),
        "scores": np.array([0.95], np.float32),
        "masks": np.ones((1, 1, 28, 28), np.float32),
    }
    outputs["boxes"] += np.array([(1088 - 1067) // 2, 0] * 2, np.float32)  # centred in whole strides
    path = constant_network(tmp_path / "zoo.onnx", [3, "h", "w"], outputs)
    path.with_suffix(".json").write_text(json.dumps({"layout": "onnx-zoo-mask-rcnn"}))
    found = load_segmenter(path).segment(IMAGE)
    assert found.label.tolist() == [ClassLabel.CAR]
    assert found.box[0] == pytest.approx([40, 60, 120, 100], abs=0.1)
    assert found.mask[0].sum() == 80 * 40


def test_rf_detr_boxes_are_shares_of_the_stretched_image(tmp_path):
    logits = np.full((1, 3, 91), -9.0, np.float32)
    logits[0, 0, 3] = 3.0  # car
    logits[0, 1, 62] = 3.0  # chair
    masks = np.full((1, 3, 54, 54), -5.0, np.float32)
    masks[0, 0, :27] = 5.0
    dets = np.array([[[0.5, 0.5, 0.25, 0.5], [0.2, 0.2, 0.1, 0.1], [0.8, 0.8, 0.1, 0.1]]], np.float32)
    outputs = {"dets": dets, "labels": logits, "masks": masks}
    found = load_segmenter(constant_network(tmp_path / "rf.onnx", [1, 3, 432, 432], outputs)).segment(IMAGE)
    assert found.label.tolist() == [ClassLabel.CAR]
    assert found.confidence == pytest.approx([1 / (1 + np.exp(-3.0))])
    assert found.box[0] == pytest.approx([120, 60, 200, 180])
    rows, columns = np.nonzero(found.mask[0])
    assert (rows.min(), columns.min(), columns.max()) == (60, 120, 199)
    assert rows.max() == pytest.approx(119, abs=3)


def test_rf_detr_class_names_come_with_recent_exports(tmp_path):
    logits = np.full((1, 1, 3), -9.0, np.float32)
    logits[0, 0, 1] = 3.0
    outputs = {
        "dets": np.array([[[0.5, 0.5, 0.25, 0.5]]], np.float32),
        "labels": logits,
        "masks": np.full((1, 1, 54, 54), 5.0, np.float32),
    }
    metadata = {"rfdetr_inference": json.dumps({"class_id_to_name": {0: "tree", 1: "traffic cone"}})}
    path = constant_network(tmp_path / "own.onnx", [1, 3, 432, 432], outputs, metadata)
    assert load_segmenter(path).segment(IMAGE).label.tolist() == [ClassLabel.CONE]


def test_a_layout_that_nobody_knows_is_named(tmp_path):
    path = constant_network(tmp_path / "odd.onnx", [1, 3, 64, 64], {"depth": np.zeros((1, 1, 64, 64), np.float32)})
    with pytest.raises(ModelError, match=r"odd\.onnx.*depth \[1, 1, 64, 64\].*known layout.*odd\.json"):
        load_segmenter(path)


def test_classes_that_do_not_fit_are_named(tmp_path):
    outputs = {"output0": yolo_rows([(9, 9, 9, 9, 0, 0.9, (1, 0))], 3), "output1": left_and_right_half(64, 80)}
    segmenter = load_segmenter(constant_network(tmp_path / "three.onnx", [1, 3, 256, 320], outputs))
    with pytest.raises(ModelError, match=r"three\.onnx.*classes.*three\.json"):
        segmenter.segment(IMAGE)


@pytest.mark.parametrize("name", ["missing.onnx", "model.pt", "nobody-made-this"])
def test_models_that_are_not_there_say_what_to_do(tmp_path, name):
    path = tmp_path / name if "." in name else name
    if name.endswith(".pt"):
        path.write_bytes(b"x")
    with pytest.raises(ModelError, match=r"give a path|export it|there are: mask-rcnn"):
        load_segmenter(path)


def test_a_damaged_model_is_one_clear_error(tmp_path):
    path = tmp_path / "damaged.onnx"
    path.write_bytes(b"\x08\x07not a model")
    with pytest.raises(ModelError, match=r"damaged\.onnx: onnxruntime cannot load it"):
        load_segmenter(path)


def test_a_wrong_configuration_names_the_field(yolo):
    yolo.with_suffix(".json").write_text('{"min_confidence": 7}')
    with pytest.raises(ModelError, match=r"yolo\.json: min_confidence"):
        load_segmenter(yolo)
