"""The ground grid on disparity images of known streets, and on real ones."""

import json

import cv2
import numpy as np
import pytest
import shapely

from autowaze.traces import open_trace
from autowaze.vehicle.ground import GroundObservation, GroundObserver
from autowaze.vehicle.ground_grid import REACH_M, GroundGrid, ground_that_matters
from autowaze.vehicle.ground_plane import fit_ground_plane, level_plane
from autowaze.world.camera import StereoCamera
from autowaze.world.frame import StereoFrame
from autowaze.world.georeference import Georeference
from autowaze.world.ground import CELL_M
from autowaze.world.parking import ParkingMap, ParkingSpot
from autowaze.world.pose import heading_to_rotation, make_pose

CAMERA = StereoCamera(720.0, 720.0, 620.5, 180.0, 0.54, 1242, 376)
HALF = CAMERA.scaled(0.5)
HEIGHT_M = 1.65


def camera_at(east=0.0, north=0.0, heading=0.0):
    return make_pose(heading_to_rotation(heading), np.array([east, north, HEIGHT_M]))


def street(boxes=(), slope=0.0, roll=0.0, height=HEIGHT_M, small=HALF):
    """Disparity of a road and of upright fronts (left, right, distance, height) in camera metres, in small images."""
    u, v = np.meshgrid(np.arange(small.width), np.arange(small.height))
    x, y = (u - small.cx) / small.fx, (v - small.cy) / small.fy
    inverse_depth = np.maximum(y + slope - roll * x, 0.0) / height  # y + slope z - roll x = height
    for left, right, distance, top in boxes:
        base = height - slope * distance
        hit = (x * distance >= left) & (x * distance <= right) & (y * distance <= base) & (y * distance >= base - top)
        inverse_depth = np.where(hit, np.maximum(inverse_depth, 1.0 / distance), inverse_depth)
    disparity = (small.bf * inverse_depth).astype(np.float32)
    return np.where(disparity > 1.0, disparity, np.float32(-1))


def look(observer, frame, T_map_cam):
    return observer.cells_of(observer.disparity(frame), T_map_cam)


def cell_at(observation, east, north):
    """What was seen of the cell at a place: (free, obstacle), or None."""
    ix, iy = int(np.floor(east / CELL_M)), int(np.floor(north / CELL_M))
    row = np.flatnonzero((observation.ix == ix) & (observation.iy == iy))
    return (bool(observation.free[row[0]]), bool(observation.obstacle[row[0]])) if len(row) else None


FREE, OBSTACLE, UNSEEN = (True, False), (False, True), None


def test_an_empty_road_is_free_up_to_the_range():
    seen = GroundObserver(CAMERA).cells_of(street(), camera_at())
    assert not seen.obstacle.any()
    assert cell_at(seen, 0.1, 10.1) == FREE
    assert cell_at(seen, 3.1, 18.1) == FREE
    assert cell_at(seen, 0.1, 27.1) == UNSEEN
    assert cell_at(seen, 0.1, -5.1) == UNSEEN


def test_where_depth_is_a_metre_wrong_nothing_is_told():
    wide = StereoCamera(528.0, 528.0, 639.5, 359.5, 0.12, 1280, 720)
    seen = GroundObserver(wide).cells_of(street(small=wide.scaled(1 / 3, 1.0)), camera_at())
    assert cell_at(seen, 0.1, 12.1) == FREE
    assert cell_at(seen, 0.1, 16.1) == UNSEEN


def test_a_car_is_an_obstacle_and_hides_what_lies_behind():
    seen = GroundObserver(CAMERA).cells_of(street([(2.0, 3.8, 12.1, 1.5)]), camera_at())
    assert cell_at(seen, 2.9, 12.1) == OBSTACLE
    assert cell_at(seen, 2.9, 11.1) == FREE
    assert cell_at(seen, 2.9, 14.1) == UNSEEN
    assert cell_at(seen, 0.1, 12.1) == FREE


@pytest.mark.parametrize(("height", "expected"), [(0.12, FREE), (0.6, OBSTACLE)])
def test_a_kerb_is_ground_and_a_planter_is_not(height, expected):
    seen = GroundObserver(CAMERA).cells_of(street([(-3.0, -1.0, 8.1, height)]), camera_at())
    assert cell_at(seen, -2.0, 8.1) == expected


def test_what_hangs_over_the_road_is_no_obstacle():
    disparity = street([(-1.0, 1.0, 12.1, 4.0)])
    below_two_metres = (np.arange(HALF.height) - HALF.cy) / HALF.fy * 12.1 > HEIGHT_M - 2.2
    disparity[below_two_metres] = street()[below_two_metres]
    seen = GroundObserver(CAMERA).cells_of(disparity, camera_at())
    assert not seen.obstacle.any()


@pytest.mark.parametrize(("slope", "roll"), [(0.05, 0.0), (-0.05, 0.0), (0.0, 0.04), (0.03, -0.03)])
def test_slopes_and_camber_are_ground(slope, roll):
    seen = GroundObserver(CAMERA).cells_of(street([(2.0, 3.8, 12.1, 1.5)], slope, roll), camera_at())
    assert cell_at(seen, 0.1, 15.1) == FREE
    assert cell_at(seen, -3.1, 15.1) == FREE
    assert cell_at(seen, 2.9, 12.1) == OBSTACLE
    assert seen.plane.height_m == pytest.approx(HEIGHT_M, abs=0.02)


def test_cells_lie_where_the_pose_says():
    T = camera_at(east=100.0, north=50.0, heading=np.pi / 2)  # looks east
    seen = GroundObserver(CAMERA).cells_of(street([(2.0, 3.8, 12.1, 1.5)]), T)
    assert cell_at(seen, 112.1, 50.0 - 2.9) == OBSTACLE
    assert cell_at(seen, 112.1, 50.0) == FREE


def test_moving_instances_leave_no_votes():
    disparity = street([(2.0, 3.8, 12.1, 1.5)])
    mask = np.zeros((CAMERA.height, CAMERA.width), np.bool_)
    left, right = (int(620.5 + 720.0 * x / 12.0) for x in (2.0, 3.8))
    mask[180:290, left : right + 1] = True
    seen = GroundObserver(CAMERA).cells_of(disparity, camera_at(), mask)
    assert not seen.obstacle.any()
    assert cell_at(seen, 0.1, 12.1) == FREE


def test_depth_is_metres_and_not_a_number_where_stereo_has_no_answer():
    disparity = street([(2.0, 3.8, 12.1, 1.5)])
    disparity[:, :20] = -1
    seen = GroundObserver(CAMERA).cells_of(disparity, camera_at())
    assert seen.depth.dtype == np.float32
    assert np.isnan(seen.depth[:, :20]).all()
    column, row = int(HALF.cx + HALF.fx * 2.9 / 12.0), int(HALF.cy + HALF.fy * 1.0 / 12.0)
    assert seen.depth[row, column] == pytest.approx(12.1, abs=0.01)


def test_the_plane_is_found_among_many_things_that_stand():
    boxes = [(-8.0, -2.2, 9.0, 3.0), (2.5, 8.0, 7.0, 2.0), (-1.0, 1.0, 20.0, 1.5)]
    rng = np.random.default_rng(0)
    disparity = street(boxes)
    disparity += rng.normal(0.0, 0.2, disparity.shape).astype(np.float32)
    plane = fit_ground_plane(disparity, HALF, (1.0, 2.4), level_plane(HALF, 1.4))
    assert plane.height_m == pytest.approx(HEIGHT_M, abs=0.03)


def test_a_wall_in_front_of_the_camera_is_no_road():
    wall = np.full((HALF.height, HALF.width), 30.0, np.float32)
    seen = GroundObserver(CAMERA).cells_of(wall, camera_at())
    assert seen.plane is None
    assert len(seen.ix) == 0


def test_a_blind_camera_sees_no_ground():
    seen = GroundObserver(CAMERA).cells_of(np.full((HALF.height, HALF.width), -1, np.float32), camera_at())
    assert len(seen.ix) == 0
    assert np.isnan(seen.depth).all()


def test_votes_of_a_window_add_up_once_per_frame_and_cell():
    observer, grid = GroundObserver(CAMERA), GroundGrid()
    seen = observer.cells_of(street([(2.0, 3.8, 12.1, 1.5)]), camera_at())
    for _ in range(3):
        grid.add(seen)
    cells = grid.cells()
    assert len(cells) == len(seen.ix)
    assert set((cells.free + cells.obstacle).tolist()) == {3}
    assert np.array_equal(np.lexsort((cells.iy, cells.ix)), np.arange(len(cells)))


def test_a_window_says_of_each_cell_what_it_mostly_was_and_no_lone_noise():
    grid = GroundGrid()
    ix, iy = (a.ravel().astype(np.int32) for a in np.meshgrid(np.arange(-20, 20), np.arange(30)))
    wall = iy >= 25
    lone = (ix == 3) & (iy == 10)
    for obstacle in (wall, wall | lone, wall | lone):
        grid.add(GroundObservation(ix, iy, ~obstacle, obstacle, np.zeros((1, 1), np.float32), HALF, None))
    classes = grid.classes()
    assert set((classes.free + classes.obstacle).tolist()) == {1}
    assert not classes.obstacle[classes.iy < 24].any() and classes.obstacle[classes.iy > 25].all()


def test_only_the_ground_at_spots_is_told_of_where_they_are_known():
    spots = ParkingMap((ParkingSpot("A", shapely.box(0.0, 0.0, 5.0, 2.0)),), Georeference(49.0, 8.4))
    grid = GroundGrid(ground_that_matters(spots))
    ix, iy = (a.ravel().astype(np.int32) for a in np.meshgrid(np.arange(-80, 80), np.arange(-80, 80)))
    free = np.ones(len(ix), bool)
    grid.add(GroundObservation(ix, iy, free, ~free, np.zeros((1, 1), np.float32), HALF, None))
    x, y = grid.classes().centre.T
    assert len(x) > 0
    assert (x > -REACH_M).all() and (x < 5 + REACH_M).all() and (y > -REACH_M).all() and (y < 2 + REACH_M).all()


def test_cells_west_and_south_of_the_origin_are_kept_apart():
    seen = GroundObserver(CAMERA).cells_of(street(), camera_at(east=-0.5, north=-20.0))
    grid = GroundGrid()
    grid.add(seen)
    assert (seen.ix < 0).any()
    assert len(grid.cells()) == len(np.unique(np.stack([seen.ix, seen.iy]), axis=1).T) == len(seen.ix)


@pytest.mark.parametrize("name", ["drive_0005", "odometry_00"])
def test_occupied_and_vacant_spots_of_a_real_street_separate(kitti, name):
    trace = open_trace(kitti / name, cameras="grey", frames=slice(90 if name == "drive_0005" else 0, None))
    T_map_world = make_pose(heading_to_rotation(0.0), np.zeros(3))
    observer, grid = GroundObserver(trace.camera), GroundGrid()
    for k in range(0, len(trace), 2):
        grid.add(look(observer, trace[k], T_map_world @ trace.ground_truth.T_world_cam[k]))
    cells = grid.cells()
    standing = cells.obstacle >= np.maximum(cells.free, 1)
    truth = json.loads((kitti / name / "truth.json").read_text())
    for feature in json.loads((kitti / name / "parking_map.geojson").read_text())["features"]:
        spot = truth[feature["properties"]["spot_id"]]
        polygon = shapely.Polygon(feature["properties"]["local_xz"]).buffer(-CELL_M)
        inside = shapely.contains_xy(polygon, *cells.centre.T)
        if spot["observable"]:
            assert inside.sum() * CELL_M**2 >= 0.15 * polygon.area, feature["properties"]
            share = (inside & standing).sum() / inside.sum()
            assert share >= 0.35 if spot["occupied"] else share <= 0.15, feature["properties"]


def test_the_same_frame_gives_the_same_cells_whatever_the_threads(kitti):
    trace = open_trace(kitti / "drive_0005", cameras="grey", frames=slice(120, 122))
    threads = cv2.getNumThreads()
    results = []
    for n in (1, 4):
        cv2.setNumThreads(n)
        observer = GroundObserver(trace.camera)
        results.append([look(observer, frame, camera_at()) for frame in trace])
    cv2.setNumThreads(threads)
    for one, many in zip(*results, strict=True):
        assert np.array_equal(one.depth, many.depth, equal_nan=True)
        assert np.array_equal(one.ix, many.ix)
        assert np.array_equal(one.obstacle, many.obstacle)


def test_the_left_edge_of_the_view_is_measured(kitti):
    trace = open_trace(kitti / "drive_0005", cameras="grey", frames=slice(120, 121))
    frame = trace[0]
    disparity = GroundObserver(trace.camera).disparity(frame)
    assert (disparity[:, :64] > 0).mean() > 0.3


@pytest.mark.parametrize("camera", [CAMERA, StereoCamera(528.0, 528.0, 639.5, 359.5, 0.12, 1280, 720)])
def test_what_is_twelve_metres_away_is_placed_to_three_cells_whatever_the_baseline(camera):
    rng, disparity = np.random.default_rng(0), camera.bf / 12.0
    wall = cv2.GaussianBlur(rng.uniform(0, 255, (camera.height, camera.width + 100)).astype(np.float32), (0, 0), 2.0)
    u, v = np.meshgrid(np.arange(camera.width, dtype=np.float32), np.arange(camera.height, dtype=np.float32))
    left, right = (cv2.remap(wall, u + 10 + shift, v, cv2.INTER_LINEAR) for shift in (0.0, np.float32(disparity)))
    left, right = (
        np.clip(4 * (x - 127) + 127 + rng.normal(0, 2, x.shape), 0, 255).astype(np.uint8) for x in (left, right)
    )
    seen = look(GroundObserver(camera), StereoFrame(0, 0.0, left, right), camera_at())
    assert (np.abs(seen.depth - 12.0) < 3 * CELL_M).mean() > 0.9
