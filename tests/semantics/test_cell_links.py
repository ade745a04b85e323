"""The bundled layout, on cells whose instances are known, and the bundled model itself."""

import numpy as np
import pytest
from graphs import constant_network

from autowaze.vehicle.semantics.average_linkage import average_linkage
from autowaze.vehicle.semantics.cell_links import CLASSES, LINKS, group_cells, lifted
from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.model_store import bundled_model
from autowaze.vehicle.semantics.segmenter import load_segmenter
from autowaze.world.errors import ModelError
from autowaze.world.labels import ClassLabel

HEIGHT, WIDTH = 128, 320  # of the network's input
VEHICLE, PERSON = 1, 3
IMAGE = np.zeros((HEIGHT, WIDTH), np.uint8)


def cells_for(*instances, sure=6.0):
    """Output that says these instances (class, left, top, right, bottom), the later before the earlier."""
    cells = np.zeros((1 + len(CLASSES) + len(LINKS), HEIGHT // 2, WIDTH // 2), np.float32)
    cells[0] = 6.0
    owner = np.zeros(cells.shape[1:], int)
    y, x = 1.0 + 2.0 * np.mgrid[: HEIGHT // 2, : WIDTH // 2]
    for place, (number, left, top, right, bottom) in enumerate(instances, start=1):
        inside = (x > left) & (x < right) & (y > top) & (y < bottom)
        cells[: 1 + len(CLASSES), inside] = 0.0
        cells[number, inside] = 6.0
        owner[inside] = place
    for link, (dx, dy) in zip(cells[-len(LINKS) :], LINKS, strict=True):
        there = np.zeros_like(owner)
        there[: HEIGHT // 2 - dy, max(-dx, 0) : WIDTH // 2 - max(dx, 0)] = owner[
            dy:, max(dx, 0) : WIDTH // 2 + min(dx, 0)
        ]
        link[:] = np.where(there == owner, sure, -sure)
    return cells


@pytest.fixture
def open_model(tmp_path):
    def opened(cells, **options):
        path = constant_network(tmp_path / "cells.onnx", [1, 1, HEIGHT, WIDTH], {"cells": cells[None]})
        return load_segmenter(path, **options)

    return opened


def test_cars_that_touch_are_two(open_model):
    found = open_model(cells_for((VEHICLE, 20, 40, 100, 90), (VEHICLE, 100, 40, 150, 90))).segment(IMAGE)
    assert found.label.tolist() == [ClassLabel.CAR, ClassLabel.CAR]
    assert sorted(found.box.tolist()) == [
        pytest.approx([20, 40, 100, 90], abs=2),
        pytest.approx([100, 40, 150, 90], abs=2),
    ]
    assert not (found.mask[0] & found.mask[1]).any()


def test_a_car_behind_another_keeps_what_is_seen_of_it(open_model):
    behind, before = (VEHICLE, 20, 30, 120, 80), (VEHICLE, 90, 40, 200, 100)
    found = open_model(cells_for(behind, before)).segment(IMAGE)
    left, right = found[np.argsort(found.box[:, 0])]
    assert left.mask[35, 110] and not right.mask[35, 110]
    assert right.mask[60, 110] and not left.mask[60, 110]


def test_cars_whose_boxes_overlap_by_half_are_two_though_links_err(open_model):
    cells = cells_for((VEHICLE, 20, 30, 120, 90), (VEHICLE, 55, 36, 155, 96), sure=3.0)
    cells[-len(LINKS) :] += np.random.default_rng(2).normal(0, 1.5, cells[-len(LINKS) :].shape)
    found = open_model(cells).segment(IMAGE)
    assert len(found) == 2
    left, right = found[np.argsort(found.box[:, 0])]
    assert left.mask[60, 40] and right.mask[60, 130]
    assert not left.mask[60, 70] and right.mask[60, 70]


def test_one_car_stays_one_however_its_links_err(open_model):
    cells = cells_for((VEHICLE, 20, 30, 180, 100), sure=3.0)
    cells[-len(LINKS) :] += np.random.default_rng(3).normal(0, 2.0, cells[-len(LINKS) :].shape)
    found = open_model(cells).segment(IMAGE)
    assert len(found) == 1
    assert found.mask[0].sum() > 0.95 * 160 * 70


def test_one_reflection_of_which_the_network_is_sure_does_not_part_a_car(open_model):
    car = cells_for((VEHICLE, 20, 30, 180, 100), sure=1.0)
    car[-len(LINKS) + LINKS.index((0, 3)), 30:33, 10:90] = -8.0  # a line across the bonnet, in one kind of link
    found = open_model(car).segment(IMAGE)
    assert len(found) == 1
    assert found.mask[0].sum() > 0.95 * 160 * 70


def test_groups_whose_links_part_them_on_average_stay_apart():
    owner = np.repeat(np.arange(3, dtype=np.int32), 20)[None].repeat(30, axis=0)
    reach = np.array([(1, 0), (3, 0)])
    links = np.full((2, 30, 60), 2.0, np.float32)
    links[:, :, 17:20] = 0.5  # the first two belong together, if only just
    links[:, :, 37:40] = -0.5
    joined = average_linkage(owner, 3, links, reach, 0.0)
    assert len(np.unique(joined[:, :40])) == 1
    assert len(np.unique(joined)) == 2
    assert len(np.unique(average_linkage(owner, 3, links, reach, 1.0))) == 1
    assert np.array_equal(average_linkage(owner, 3, links, reach, -1.0), owner)


def test_a_person_before_a_car_is_not_part_of_it(open_model):
    found = open_model(cells_for((VEHICLE, 40, 40, 160, 100), (PERSON, 90, 30, 110, 110))).segment(IMAGE)
    assert sorted(found.label.tolist()) == [ClassLabel.CAR, ClassLabel.PERSON]
    car = found[found.label == ClassLabel.CAR]
    assert len(car) == 1
    assert not car.mask[0, 70, 100]  # and what the person parts is one car


def test_shadows_of_a_dark_picture_are_lifted_and_bright_ones_stay():
    ramp = np.tile(np.arange(256, dtype=np.uint8), (40, 1))
    dark = lifted(ramp // 2)
    assert 115 < dark.mean() < 140
    assert (np.diff(dark[0].astype(int)) >= 0).all()
    assert np.array_equal(lifted(255 - ramp // 2), 255 - ramp // 2)
    night = np.full((40, 60), 10, np.uint8)
    assert 10 < lifted(night).max() < 60  # noise is not blown up to daylight
    assert np.array_equal(lifted(np.zeros_like(night)), np.zeros_like(night))


def test_links_that_nobody_trusts_say_nothing(open_model):
    cells = cells_for((VEHICLE, 20, 40, 100, 90))
    assert len(open_model(cells).segment(IMAGE)) == 1
    cells[-len(LINKS) :] = 0.0
    assert len(open_model(cells).segment(IMAGE)) == 0


def test_a_post_parts_a_car_and_it_is_still_one(open_model):
    cells = cells_for((VEHICLE, 20, 30, 180, 100))
    cells[0, :, 50:53] = 20.0  # what stands before it
    found = open_model(cells).segment(IMAGE)
    assert len(found) == 1
    assert found.mask[0, 60, 40] and found.mask[0, 60, 160] and not found.mask[0, 60, 102]


def test_a_seam_that_the_near_links_miss_is_found_by_those_across_it(open_model):
    cells = cells_for((VEHICLE, 20, 40, 100, 90), (VEHICLE, 100, 40, 180, 90))
    near = [-len(LINKS) + i for i, (dx, dy) in enumerate(LINKS) if max(dx, dy) == 1]
    cells[near] = 0.5
    assert len(open_model(cells).segment(IMAGE)) == 2


def test_a_rest_of_a_vehicle_is_no_vehicle_but_a_cone_may_be_as_small(open_model):
    cone = 1 + CLASSES.index("cone")
    found = open_model(cells_for((VEHICLE, 20, 40, 100, 90), (VEHICLE, 150, 40, 168, 56), (cone, 200, 40, 210, 56)))
    assert sorted(found.segment(IMAGE).label.tolist()) == sorted([ClassLabel.CAR, ClassLabel.CONE])


def test_masks_come_at_the_size_of_the_image(open_model):
    large = np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)
    found = open_model(cells_for((VEHICLE, 20, 40, 100, 90))).segment(large)
    assert found.mask.shape == (1, 2 * HEIGHT, 2 * WIDTH)
    assert found.box[0] == pytest.approx([40, 80, 200, 180], abs=3)


def test_a_picture_without_anything_is_no_trouble(open_model):
    assert len(open_model(cells_for()).segment(IMAGE)) == 0
    owner, _, confidence, numbers = group_cells(cells_for())
    assert (owner == -1).all() and len(confidence) == len(numbers) == 0


def test_wild_cells_are_bounded():
    wild = np.random.default_rng(5).normal(0, 30, (1 + len(CLASSES) + len(LINKS), 120, 400)).astype(np.float32)
    owner, _, confidence, numbers = group_cells(wild)
    assert owner.max() < len(numbers) <= 100
    assert ((confidence >= 0) & (confidence <= 1)).all()


def test_classes_that_do_not_fit_the_channels_are_named(tmp_path):
    cells = np.zeros((1, 14, 8, 8), np.float32)
    path = constant_network(tmp_path / "three.onnx", [1, 1, 16, 16], {"cells": cells})
    with pytest.raises(ModelError, match=r"14 channels do not fit 4 classes.*three.json"):
        load_segmenter(path)


def test_the_bundled_model_is_small_free_and_opens_without_a_network():
    path = bundled_model()
    assert path.stat().st_size <= 6_000_000
    assert ModelConfig.beside(path).licence == "Apache-2.0"
    found = load_segmenter("bundled").segment(np.random.default_rng(1).integers(0, 255, (375, 1242), np.uint8))
    assert found.mask.shape[1:] == (375, 1242)
    assert len(found) <= 3  # noise is not a street
