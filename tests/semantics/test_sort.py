"""SORT on boxes whose motion is known."""

import numpy as np
import pytest

from autowaze.vehicle.semantics.billboard import Billboards
from autowaze.vehicle.semantics.box_filter import BoxFilter, boxes_to_measurements, states_to_boxes
from autowaze.vehicle.semantics.instance_depth import InstanceDepths
from autowaze.vehicle.semantics.sort import Sort
from autowaze.world.camera import StereoCamera
from autowaze.world.instances import Detections
from autowaze.world.labels import ClassLabel
from autowaze.world.pose import heading_to_rotation, make_pose

CAMERA = StereoCamera(720.0, 720.0, 620.0, 187.0, 0.54, 1240, 375)


def detections(*boxes, label=ClassLabel.CAR):
    n = len(boxes)
    return Detections(
        np.array(boxes, np.float32).reshape(n, 4),
        np.full(n, label, np.uint8),
        np.full(n, 0.9, np.float32),
        np.zeros((n, 4, 4), np.bool_),
    )


def parked_car(x, z, T_map_cam, width=1.8, height=1.5):
    """Box and depths of the back of a car at (x, z) ahead of the first camera, as a camera further on sees it."""
    z_now = z - T_map_cam[1, 3]
    left, right = (620.0 + 720.0 * (x + s * width / 2) / z_now for s in (-1, 1))
    top, bottom = (187.0 + 720.0 * y / z_now for y in (1.65 - height, 1.65))
    return tuple(np.clip((left, top, right, bottom), 0, [1240, 375, 1240, 375])), z_now


def depths(*z):
    d = np.array(z, np.float64)
    return InstanceDepths(d, d, d - 0.3, d + 0.3)


def at(z):
    """The camera of a car driving north, z metres on."""
    return make_pose(heading_to_rotation(0.0), np.array([0.0, z, 0.0]))


def test_boxes_survive_the_way_to_filter_states_and_back():
    boxes = np.array([[10.0, 20.0, 110.0, 60.0], [0.0, 0.0, 5.0, 50.0]])
    assert np.allclose(states_to_boxes(boxes_to_measurements(boxes)), boxes)


def test_filter_learns_a_constant_velocity():
    box_filter = BoxFilter()
    box_filter.add(boxes_to_measurements(np.array([[0.0, 100.0, 60.0, 140.0]])))
    for k in range(1, 30):
        box_filter.predict(np.zeros((1, 4)))
        box_filter.correct(np.array([0]), boxes_to_measurements(np.array([[5.0 * k, 100.0, 60.0 + 5.0 * k, 140.0]])))
    assert box_filter.mean[0, 4] == pytest.approx(5.0, abs=0.1)
    assert box_filter.mean[0, 5] == pytest.approx(0.0, abs=0.1)


def test_a_box_keeps_its_id_while_it_moves():
    sort = Sort()
    ids = [sort.update(detections((k * 8, 100, k * 8 + 60, 140))).id.tolist() for k in range(20)]
    assert ids == [[1]] * 20


def test_two_cars_that_pass_each_other_keep_their_ids():
    sort = Sort()
    for k in range(30):
        tracks = sort.update(detections((k * 12, 100, k * 12 + 80, 150), (340 - k * 12, 120, 420 - k * 12, 170)))
    assert tracks.id.tolist() == [1, 2]


def test_ids_are_positive_and_never_used_twice():
    sort = Sort()
    seen = []
    for k in range(10):
        for _ in range(3):
            tracks = sort.update(detections((100 * k, 0, 100 * k + 50, 40)))
        seen.append(int(tracks.id[0]))
        for _ in range(3):
            sort.update(detections())
    assert seen == list(range(1, 11))


def test_a_person_never_continues_the_track_of_a_car():
    sort = Sort()
    sort.update(detections((100, 100, 160, 140)))
    assert sort.update(detections((100, 100, 160, 140), label=ClassLabel.PERSON)).id.tolist() == [2]


def test_a_van_called_car_and_truck_in_turn_is_one_track_with_one_label():
    sort = Sort()
    for label in (ClassLabel.CAR, ClassLabel.TRUCK, ClassLabel.CAR, ClassLabel.TRUCK, ClassLabel.CAR):
        tracks = sort.update(detections((100, 100, 200, 180), label=label))
    assert tracks.id.tolist() == [1]
    assert tracks.label.tolist() == [ClassLabel.CAR]


def test_an_empty_frame_gives_no_tracks():
    assert len(Sort().update(Detections.empty(4, 4))) == 0


def test_a_parked_car_that_sweeps_through_the_image_needs_ego_motion():
    plain, helped = Sort(), Sort(CAMERA)
    plain_ids, helped_ids = set(), set()
    for k in range(9):
        box, z = parked_car(x=4.0, z=20.0, T_map_cam=at(2.0 * k))  # 20 m/s at 10 Hz
        plain_ids.update(plain.update(detections(box)).id.tolist())
        helped_ids.update(helped.update(detections(box), at(2.0 * k), depths(z)).id.tolist())
    assert helped_ids == {1}
    assert len(plain_ids) > 1


def test_a_parked_car_hidden_for_a_second_gets_its_id_back():
    sort = Sort(CAMERA)
    for k in range(20):
        box, z = parked_car(x=4.0, z=25.0, T_map_cam=at(0.7 * k))
        hidden = 5 <= k < 15
        tracks = sort.update(
            detections() if hidden else detections(box), at(0.7 * k), depths() if hidden else depths(z)
        )
    assert tracks.id.tolist() == [1]


def test_a_parked_car_that_another_slid_before_is_awaited_where_it_stood():
    sort = Sort(CAMERA)
    for k in range(26):
        box, z = parked_car(x=4.0, z=25.0, T_map_cam=at(0.3 * k))
        left, top, right, bottom = box
        covered = np.clip((k - 4) / 9, 0.0, 1.0)  # from the left, until less is seen than a detection needs
        hidden = 10 <= k < 20
        seen = box if hidden or k >= 20 else (left + covered * (right - left), top, right, bottom)
        tracks = sort.update(
            detections() if hidden else detections(seen), at(0.3 * k), depths() if hidden else depths(z)
        )
    assert tracks.id.tolist() == [1]


def test_a_car_of_which_now_one_end_is_seen_and_now_the_other_keeps_its_id():
    sort = Sort(CAMERA)
    ids = set()
    for k in range(14):
        (left, top, right, bottom), z = parked_car(x=4.0, z=16.0, T_map_cam=at(0.2 * k), width=4.2)
        third = (right - left) / 3
        if 6 <= k < 9:
            right = left + third
        elif k >= 9:
            left = right - third
        ids.update(sort.update(detections((left, top, right, bottom)), at(0.2 * k), depths(z)).id.tolist())
    assert ids == {1}


def test_a_car_that_comes_to_sight_at_its_other_end_keeps_its_id():
    sort = Sort(CAMERA)
    ids = set()
    for k in range(12):
        (left, top, right, bottom), z = parked_car(x=-4.0, z=16.0, T_map_cam=at(0.3 * k), width=4.2)
        half = (left + right) / 2
        seen = (half, top, right, bottom) if k < 5 else (left, top, half - 4.0, bottom)
        hidden = 5 <= k < 9  # another car passes, and only the nearer end was ever seen
        tracks = sort.update(
            detections() if hidden else detections(seen), at(0.3 * k), depths() if hidden else depths(z)
        )
        ids.update(tracks.id.tolist())
    assert ids == {1}


def test_the_next_car_in_the_row_is_not_taken_for_the_hidden_one():
    sort = Sort(CAMERA)
    first, z = parked_car(x=4.0, z=16.0, T_map_cam=at(0.0))
    assert sort.update(detections(first), at(0.0), depths(z)).id.tolist() == [1]
    sort.update(detections(), at(0.3), depths())
    following, z = parked_car(x=4.0, z=21.5, T_map_cam=at(0.6))
    assert sort.update(detections(following), at(0.6), depths(z)).id.tolist() == [2]


def test_a_sliver_uncovered_in_a_frame_is_still_the_same_car():
    sort = Sort(CAMERA)
    (left, top, right, bottom), z = parked_car(x=-3.0, z=12.0, T_map_cam=at(0.0), width=4.2)
    sliver = (left, top, left + 0.15 * (right - left), bottom)
    assert sort.update(detections(sliver), at(0.0), depths(np.nan)).id.tolist() == [1]
    assert sort.update(detections((left, top, right, bottom)), at(0.0), depths(z)).id.tolist() == [1]


def test_what_lies_behind_is_not_waited_for():
    sort = Sort(CAMERA)
    box, z = parked_car(x=3.0, z=8.0, T_map_cam=at(0.0))
    assert sort.update(detections(box), at(0.0), depths(z)).id.tolist() == [1]
    for k in range(1, 6):
        sort.update(detections(), at(3.0 * k), depths())
    passed = (1000.0, 200.0, 1240.0, 375.0)
    assert sort.update(detections(passed), at(16.0), depths(np.nan)).id.tolist() == [2]


def test_a_car_whose_lower_half_is_hidden_is_not_taken_for_one_farther_away():
    sort = Sort(CAMERA)
    ids = set()
    for k in range(12):
        (left, top, right, bottom), z = parked_car(x=4.0, z=16.0, T_map_cam=at(0.2 * k), width=4.2)
        if 3 <= k < 10:  # and what is left has no feature to tell how far away it is
            bottom -= min(k - 2, 4) / 6 * (bottom - top)
        known = depths(np.nan if 3 <= k < 9 else z)
        ids.update(sort.update(detections((left, top, right, bottom)), at(0.2 * k), known).id.tolist())
    assert ids == {1}


@pytest.mark.parametrize(("z_now", "is_same"), [(13.5, True), (19.0, False)])
def test_a_car_of_which_only_the_far_end_is_left_to_see_keeps_its_id(z_now, is_same):
    sort = Sort(CAMERA)
    for k in range(6):
        box, z = parked_car(-3.0, 16.0, at(k), width=4.0)
        sort.update(detections(box), at(k), depths(z))
    (left, top, right, bottom), _ = parked_car(-3.0, 16.0, at(6), width=4.0)
    upper = (left, top, right, top + 0.35 * (bottom - top))
    tracks = sort.update(detections(upper), at(6), depths(z_now))
    assert (tracks.id.tolist() == [1]) == is_same


def test_what_is_very_near_keeps_its_id_where_its_place_is_foretold_badly():
    sort = Sort(CAMERA)
    assert sort.update(detections((700.0, 100.0, 1240.0, 375.0)), at(0.0), depths(2.0)).id.tolist() == [1]
    assert sort.update(detections((740.0, 95.0, 1240.0, 375.0)), at(1.3), depths(7.0)).id.tolist() == [1]


def test_a_nearer_car_does_not_take_over_the_id_of_the_one_it_hides():
    sort = Sort(CAMERA)
    behind, z_behind = parked_car(x=3.0, z=24.0, T_map_cam=at(0.0))
    assert sort.update(detections(behind), at(0.0), depths(z_behind)).id.tolist() == [1]
    left, top, right, bottom = behind
    in_front = (left - 10.0, top - 10.0, right + 12.0, bottom + 16.0)
    assert sort.update(detections(in_front), at(0.0), depths(16.0)).id.tolist() == [2]
    assert sort.update(detections(behind), at(0.0), depths(z_behind)).id.tolist() == [1]


def test_a_car_ahead_at_our_speed_is_followed_though_it_does_not_stand():
    sort = Sort(CAMERA)
    ids = set()
    for k in range(30):
        T = at(1.0 * k)
        box, z = parked_car(x=0.5, z=15.0 + 1.0 * k, T_map_cam=T)
        ids.update(sort.update(detections(box), T, depths(z)).id.tolist())
    assert ids == {1}


def test_a_strip_behind_passing_traffic_is_not_at_its_distance():
    sort, parked_ids = Sort(CAMERA), set()
    for k in range(14):
        (left, top, right, bottom), z = parked_car(x=-6.0, z=18.0, T_map_cam=at(0.2 * k), width=4.2)
        if 5 <= k < 8:  # a lorry passes before it
            sort.update(detections((0.0, 60.0, right + 20.0, 370.0)), at(0.2 * k), depths(5.0))
        elif k == 8:  # then its far end shows, and all windows reach over the edge of the lorry
            strip = (right - 0.2 * (right - left), top, right, bottom)
            lorry = (0.0, 60.0, strip[0], 370.0)
            tracks = sort.update(detections(strip, lorry), at(0.2 * k), depths(5.0, 5.0))
            parked_ids.add(int(tracks.id[0]))
        else:
            parked_ids.update(sort.update(detections((left, top, right, bottom)), at(0.2 * k), depths(z)).id.tolist())
    assert parked_ids == {1}


def test_a_thing_seen_at_its_other_end_is_foretold_where_it_is_seen():
    sort = Sort(CAMERA)
    (left, top, right, bottom), z = parked_car(x=-4.0, z=12.0, T_map_cam=at(0.0), width=4.2)
    near_end = (left, top, left + 0.3 * (right - left), bottom)
    far_end = (right - 0.3 * (right - left), top, right, bottom)
    for seen in (near_end, near_end, near_end):
        assert sort.update(detections(seen), at(0.0), depths(z)).id.tolist() == [1]
    sort.update(detections(), at(0.0), depths())
    assert sort.update(detections(far_end), at(0.0), depths(z)).id.tolist() == [1]
    assert sort.update(detections(far_end), at(0.0), depths(z)).id.tolist() == [1]


def test_a_car_ahead_that_a_pole_lent_its_depth_is_not_left_on_our_bonnet():
    billboards = Billboards(CAMERA)
    billboards.add(1)
    for k in range(20):
        T = at(0.2 * k)
        box, _ = parked_car(x=0.5, z=20.0 + 0.2 * k, T_map_cam=T)
        billboards.shift(T)
        lent = depths(2.0 if 8 <= k < 11 else np.nan)
        billboards.place(np.array([0]), np.array([box], np.float32), np.array([ClassLabel.CAR]), lent)
    assert billboards.depth()[0] == pytest.approx(20.0, rel=0.2)


@pytest.mark.parametrize(("hidden_for", "is_same"), [(9, True), (14, False)])
def test_traffic_hidden_for_a_second_goes_on_where_it_stood_in_the_image(hidden_for, is_same):
    sort = Sort(CAMERA)
    for k in range(20 + hidden_for):
        T = at(1.0 * k)
        box, z = parked_car(x=0.5, z=25.0 + 1.0 * k, T_map_cam=T)
        seen = k < 18 or k >= 18 + hidden_for
        tracks = sort.update(
            detections(box) if seen else detections(), T, depths(z) if seen else depths(), moving_ids=[1]
        )
    assert (tracks.id.tolist() == [1]) == is_same


def test_traffic_seen_but_once_is_not_waited_for():
    sort = Sort(CAMERA)
    box, z = parked_car(x=0.5, z=25.0, T_map_cam=at(0.0))
    sort.update(detections(box), at(0.0), depths(z))
    for k in range(1, 5):
        sort.update(detections(), at(1.0 * k), depths(), moving_ids=[1])
    assert sort.update(detections(box), at(5.0), depths(z), moving_ids=[1]).id.tolist() == [2]
