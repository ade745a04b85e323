"""The truth of a frame must agree with itself: depth, ids, boxes, stereo, motion."""

import os
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from small_street import small_street

from autowaze.simulator import SimulatedFrame, SimulatedTrace
from autowaze.simulator.mesh import box
from autowaze.simulator.render.renderer import clip_from_camera, metres_from_depth
from autowaze.world.labels import VEHICLES
from autowaze.world.pose import inverse, transform


@pytest.fixture(scope="module")
def frame(trace: SimulatedTrace) -> SimulatedFrame:
    return trace.render(30)


def test_the_road_has_the_depth_of_a_plane(trace: SimulatedTrace, frame: SimulatedFrame) -> None:
    """Points of the road that the truth sees project to where its depth image has their distance."""
    camera = trace.camera
    ahead = trace.drive.ego.pose(float(trace.drive.ego.frame_times[45]))[:2, 3]
    points = np.array([[*ahead, 0.0], [ahead[0] + 0.3, ahead[1] + 0.2, 0.0]])
    local = transform(inverse(frame.T_map_cam), points)
    uv = camera.project(local)[:, :2]
    for (u, v), z in zip(np.round(uv).astype(int), local[:, 2], strict=True):
        if frame.ids[v, u] == 0:
            assert frame.depth[v, u] == pytest.approx(z, rel=0.05)


def test_ids_lie_inside_the_boxes_of_their_vehicles(trace: SimulatedTrace, frame: SimulatedFrame) -> None:
    vehicles = {v.id: v for v in frame.vehicles}
    seen = [i for i in np.unique(frame.ids) if i in vehicles]
    assert len(seen) >= 3
    for id in seen:
        v, u = np.nonzero(frame.ids == id)
        points = trace.camera.back_project(np.stack([u, v], -1), frame.depth[v, u])
        box_ = vehicles[id]
        local = transform(frame.T_map_cam, points) - box_.centre
        c, s = np.cos(box_.heading_rad), np.sin(box_.heading_rad)
        along, across = local[:, 0] * c + local[:, 1] * s, -local[:, 0] * s + local[:, 1] * c
        margin = 0.22  # mirrors, and half a pixel far away
        assert np.abs(along).max() < box_.length / 2 + margin
        assert np.abs(across).max() < box_.width / 2 + margin
        assert np.abs(local[:, 2]).max() < box_.height / 2 + margin


def test_every_instance_in_the_image_is_known(trace: SimulatedTrace, frame: SimulatedFrame) -> None:
    known = {thing.id for thing in (*trace.drive.still, *(actor.thing for actor in trace.drive.actors))}
    assert set(np.unique(frame.ids)) <= known | {0}


def test_disparity_agrees_with_depth(trace: SimulatedTrace, frame: SimulatedFrame) -> None:
    """Warping the right image by the true disparity gives the left one back."""
    camera = trace.camera
    left, right = frame.stereo.left_grey.astype(float), frame.stereo.right_grey.astype(float)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    u_right = u - camera.bf / frame.depth

    def difference(shift: float) -> float:
        column = np.clip(np.round(u_right + shift), 0, camera.width - 1).astype(int)
        ok = (u_right > 2) & (frame.depth < 40)
        return float(np.median(np.abs(left - right[v, column])[ok]))

    assert difference(0.0) < 6.0
    assert difference(0.0) < 0.6 * min(difference(4.0), difference(-4.0))


def test_a_spot_is_occupied_by_the_car_that_stands_on_it(trace: SimulatedTrace) -> None:
    occupants = trace.drive.occupants()
    for car in trace.street.parked:
        assert occupants[car.bay.id][0] == car.thing.id
    taken = {car.bay.id for car in trace.street.parked}
    assert all((occupants[bay.id] == 0).all() for bay in trace.street.plan.bays if bay.id not in taken)


def test_a_car_that_leaves_frees_its_spot() -> None:
    drive = SimulatedTrace(small_street(ego={"frames": 110}, traffic={"leaving": 1, "oncoming": 0})).drive
    [left] = [a for a in drive.actors if a.thing.label in VEHICLES]
    history = next(column for column in drive.occupants().values() if left.thing.id in column)
    assert history[0] == left.thing.id
    assert history[-1] == 0


def test_a_car_that_arrives_takes_its_spot() -> None:
    drive = SimulatedTrace(
        small_street(ego={"frames": 150}, traffic={"leaving": 0, "arriving": 1, "oncoming": 0})
    ).drive
    [came] = [a for a in drive.actors if a.thing.label in VEHICLES]
    history = next(column for column in drive.occupants().values() if came.thing.id in column)
    assert history[0] == 0
    assert history[-1] == came.thing.id


def test_moving_vehicles_move_like_vehicles(trace: SimulatedTrace) -> None:
    for actor in trace.drive.actors:
        steps = [
            np.linalg.norm(b[:2, 3] - a[:2, 3])
            for a, b in pairwise(actor.poses)
            if np.isfinite(a[0, 0]) and np.isfinite(b[0, 0])
        ]
        assert max(steps, default=0.0) < 1.5  # 15 m/s at 10 frames a second


def test_near_spots_are_seen_and_far_ones_are_not(trace: SimulatedTrace, frame: SimulatedFrame) -> None:
    eye = frame.T_map_cam[:2, 3]
    seen = {view.spot_id for view in frame.spots if view.seen}
    assert seen
    for bay in trace.street.plan.bays:
        if np.linalg.norm(bay.centre - eye) > 30 or (bay.centre - eye) @ frame.T_map_cam[:2, 2] < -6:
            assert bay.id not in seen


def test_a_frame_is_the_same_whenever_it_is_asked_for(trace: SimulatedTrace, frame: SimulatedFrame) -> None:
    trace.render(5)
    again = trace.render(30)
    assert np.array_equal(again.stereo.left, frame.stereo.left)
    assert np.array_equal(again.stereo.right, frame.stereo.right)
    assert np.array_equal(again.ids, frame.ids)
    assert np.array_equal(again.depth, frame.depth)


def test_another_drive_changes_cars_but_not_the_street(trace: SimulatedTrace, frame: SimulatedFrame) -> None:
    other = SimulatedTrace(small_street(drive=1))
    assert [b.id for b in other.street.plan.bays] == [b.id for b in trace.street.plan.bays]
    assert [c.thing.tint for c in other.street.parked] != [c.thing.tint for c in trace.street.parked]
    assert other.street.plan.asphalt.equals(trace.street.plan.asphalt)


def test_a_share_of_the_parked_cars_has_changed_since_another_drive(trace: SimulatedTrace) -> None:
    def standing(drive: SimulatedTrace) -> set[tuple[str, bytes]]:
        return {(car.bay.id, car.thing.T_map_thing.tobytes()) for car in drive.street.parked}

    before, spots = standing(trace), len(trace.street.plan.bays)
    later = standing(SimulatedTrace(small_street(drive=1, parking={"drive": 0, "changed": 0.6})))
    assert standing(SimulatedTrace(small_street(drive=1, parking={"drive": 0}))) == before
    assert len({bay for bay, _ in later ^ before}) <= round(0.6 * spots)
    assert 0.2 * spots <= len(later & before) <= 0.4 * spots


def test_the_other_lane_leads_the_other_way(trace: SimulatedTrace) -> None:
    there = trace.ground_truth.T_world_cam[0]
    back = SimulatedTrace(small_street(ego={"opposite": True, "frames": None})).ground_truth.T_world_cam[-1]
    assert there[:2, 2] @ back[:2, 2] < -0.95
    to_the_left = -there[:2, 0] @ (back[:2, 3] - there[:2, 3])
    assert 2.5 < to_the_left < 3.7


@pytest.fixture(scope="module")
def dusk() -> Iterator[SimulatedTrace]:
    simulated = SimulatedTrace(small_street(light={"weather": "dusk"}, effects={"grey": True, "lens_dirt": 0.5}))
    yield simulated
    simulated.close()


def test_dusk_is_darker_and_a_grey_camera_is_grey(dusk: SimulatedTrace, frame: SimulatedFrame) -> None:
    picture = dusk[30].left
    assert picture.shape == (140, 360)
    assert picture.mean() < 0.85 * frame.stereo.left_grey.mean()


def test_projection_and_depth_buffer_are_inverse(trace: SimulatedTrace) -> None:
    for z in (0.5, 7.0, 90.0):
        point = np.array([0.3 * z, 0.1 * z, z, 1.0])
        clip = clip_from_camera(trace.camera) @ point
        u = (clip[0] / clip[3] + 1) / 2 * trace.camera.width - 0.5
        assert u == pytest.approx(trace.camera.project(point[None, :3])[0, 0])
        depth = np.array([(clip[2] / clip[3] + 1) / 2], np.float64)
        assert metres_from_depth(depth)[0] == pytest.approx(z, rel=1e-3)


def test_a_box_is_closed_and_faces_outwards() -> None:
    solid = box((0, 0, 0), (1, 2, 3))
    a, b, c = (solid.position[solid.faces[:, i]] for i in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(6.0)


def test_without_egl_one_line_names_the_packages() -> None:
    code = (
        "import moderngl\n"
        "def refuse(**kwargs): raise RuntimeError('libEGL.so.1 not loaded')\n"
        "moderngl.create_standalone_context = refuse\n"
        "from autowaze.simulator.render.gl import open_context\n"
        "from autowaze.world.errors import DependencyError\n"
        "try: open_context()\n"
        "except DependencyError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    assert "apt-get install libegl1 libgl1 libgl1-mesa-dri" in done.stdout
    assert done.stdout.count("\n") == 1
