"""Features in masks."""

import numpy as np
import pytest
from scene import CAMERA, camera_at, random_descriptors, see

from autowaze.vehicle.semantics.association import associate
from autowaze.vehicle.semantics.instance_depth import measure_depths
from autowaze.world.instances import Detections, Tracks
from autowaze.world.labels import ClassLabel

SIZE = (CAMERA.height, CAMERA.width)


def tracks(*rows):
    """Tracks of (id, label, box) whose masks fill their boxes."""
    out = Tracks.empty(*SIZE)
    parts = [out]
    for track_id, label, (x0, y0, x1, y1) in rows:
        mask = np.zeros((1, *SIZE), np.bool_)
        mask[0, y0:y1, x0:x1] = True
        parts.append(
            Tracks(
                np.array([track_id], np.int32),
                np.array([[x0, y0, x1, y1]], np.float32),
                np.array([label], np.uint8),
                np.array([0.9], np.float32),
                mask,
            )
        )
    return Tracks.concatenate(parts)


def features_at(uv, depth):
    """Unlabelled features at pixels (N, 2) and depths (N,)."""
    uv = np.asarray(uv, np.float64)
    points = CAMERA.back_project(uv, np.broadcast_to(depth, len(uv)))
    T = camera_at(0.0, 0.0)
    descriptors = random_descriptors(np.random.default_rng(0), len(uv))
    return see(points @ T[:3, :3].T + T[:3, 3], T, descriptors, 0)


def grid(x0, y0, x1, y1, step=10):
    x, y = np.meshgrid(np.arange(x0, x1, step), np.arange(y0, y1, step))
    return np.column_stack([x.ravel(), y.ravel()])


def test_features_in_a_mask_get_its_label_and_id():
    uv = np.vstack([grid(210, 110, 290, 190), [[100.0, 100.0]]])
    labelled = associate(features_at(uv, 12.0), tracks((5, ClassLabel.TRUCK, (200, 100, 300, 200))))
    assert set(labelled.instance_id[:-1]) == {5}
    assert set(labelled.label[:-1]) == {ClassLabel.TRUCK}
    assert (labelled.label[-1], labelled.instance_id[-1]) == (ClassLabel.BACKGROUND, 0)


def test_features_on_the_very_edge_of_a_mask_stay_background():
    uv = np.array([[200.0, 150.0], [299.0, 150.0], [250.0, 100.0], [202.0, 150.0]])
    labelled = associate(features_at(uv, 12.0), tracks((5, ClassLabel.CAR, (200, 100, 300, 200))))
    assert labelled.instance_id.tolist() == [0, 0, 0, 5]


def test_the_nearer_instance_wins_where_masks_overlap():
    near, far = grid(205, 105, 295, 195), grid(305, 105, 395, 195)
    both = tracks((1, ClassLabel.CAR, (200, 100, 300, 200)), (2, ClassLabel.CAR, (250, 100, 400, 200)))
    features = features_at(np.vstack([near, far]), np.repeat([8.0, 14.0], [len(near), len(far)]))
    for order in (np.array([0, 1]), np.array([1, 0])):
        labelled = associate(features, both[order])
        assert set(labelled.instance_id[: len(near)]) == {1}
        assert set(labelled.instance_id[len(near) :]) == {2}


def test_a_wall_seen_through_the_windows_stays_background():
    uv = grid(205, 105, 295, 195)
    depth = np.full(len(uv), 10.0)
    depth[:12] = 16.0
    labelled = associate(features_at(uv, depth), tracks((3, ClassLabel.CAR, (200, 100, 300, 200))))
    assert set(labelled.instance_id[:12]) == {0}
    assert set(labelled.instance_id[12:]) == {3}


def test_no_tracks_leave_all_features_background():
    labelled = associate(features_at(grid(0, 0, 100, 100), 9.0), Tracks.empty(*SIZE))
    assert not labelled.label.any()
    assert not labelled.instance_id.any()


def test_the_side_of_a_car_along_the_kerb_has_a_near_and_a_far_edge():
    uv = grid(705, 105, 895, 195)
    depth = 1.0 / np.interp(uv[:, 0], [700, 900], [1 / 12.0, 1 / 8.0])  # a plane: linear in inverse depth
    mask = tracks((1, ClassLabel.CAR, (700, 100, 900, 200)))
    found = measure_depths(features_at(uv, depth), Detections(mask.box, mask.label, mask.confidence, mask.mask))
    assert np.allclose([found.left[0], found.right[0]], [12.0, 8.0], atol=0.3)
    assert found.near[0] < found.far[0]


def test_too_few_features_leave_the_depth_unknown():
    mask = tracks((1, ClassLabel.CAR, (700, 100, 900, 200)))
    found = measure_depths(features_at(np.array([[750.0, 150.0], [800.0, 150.0]]), 9.0), mask)
    assert np.isnan(found.left[0])
    assert np.isnan(found.near[0])


def test_what_stands_before_a_car_does_not_lend_it_its_depth():
    hidden, before = (200, 100, 300, 190), (300, 100, 420, 220)
    own, seam, nearer = grid(205, 105, 285, 185), grid(296, 105, 299, 185), grid(310, 110, 410, 210)
    depth = np.repeat([12.0, 6.0, 6.0], [len(own), len(seam), len(nearer)])
    seen = features_at(np.vstack([own, seam, nearer]), depth)
    found = measure_depths(seen, tracks((1, ClassLabel.CAR, hidden), (2, ClassLabel.CAR, before)))
    assert found.near.tolist() == pytest.approx([12.0, 6.0], abs=0.1)


@pytest.mark.parametrize(("depth", "expected"), [(12.0, 12.0), (6.0, np.nan)])
def test_a_strip_beside_a_nearer_car_has_a_depth_only_if_it_lies_behind_that_one(depth, expected):
    strip, before = (290, 100, 300, 190), (300, 100, 420, 220)
    seam, nearer = grid(296, 105, 299, 185), grid(310, 110, 410, 210)
    seen = features_at(np.vstack([seam, nearer]), np.repeat([depth, 6.0], [len(seam), len(nearer)]))
    found = measure_depths(seen, tracks((1, ClassLabel.CAR, strip), (2, ClassLabel.CAR, before)))
    assert found.left[0] == pytest.approx(expected, abs=0.1, nan_ok=True)
