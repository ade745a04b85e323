"""Ways along streets, against a town that one can draw on squared paper and against brute force."""

import heapq
from itertools import pairwise

import numpy as np
import pytest
import shapely
from shapely import LineString

from autowaze.cloud.routing import ASIDE_DRIVING_MPS, WALKING_MPS, StreetGraph, TravelMode
from autowaze.cloud.street_joints import pieces_between_joints
from autowaze.world.streets import streets


def way(graph, start, goal, limit_s=1e5):
    """Seconds, metres and positions between two points."""
    search = graph.search(graph.place(np.array([start])), limit_s)
    goal = graph.place(np.array([goal]))
    seconds = float(graph.durations(search, goal)[0])
    if not np.isfinite(seconds):
        return np.inf, np.inf, None
    return seconds, *graph.route(search, goal)


def square(oneway=False):
    """A block of 100 m; the south side is one long street through its corners, named from west to east."""
    lines = [
        LineString([(-100, 0), (0, 0), (100, 0), (200, 0)]),
        LineString([(0, 0), (0, 100)]),
        LineString([(0, 100), (100, 100)]),
        LineString([(100, 100), (100, 0)]),
    ]
    return streets(lines, oneway=[oneway, False, False, False], speed_kmh=[36.0, 36.0, 36.0, 36.0])


def test_one_walks_around_the_block_the_shorter_way():
    graph = StreetGraph(square(), TravelMode.WALKING)
    seconds, metres, path = way(graph, (10, 0), (50, 100))
    assert metres == pytest.approx(10 + 100 + 50)
    assert seconds == pytest.approx(metres / WALKING_MPS)
    assert path.tolist() == [[10, 0], [0, 0], [0, 100], [50, 100]]
    assert way(graph, (90, 0), (50, 100))[2].tolist() == [[90, 0], [100, 0], [100, 100], [50, 100]]


def test_the_way_begins_and_ends_beside_the_street():
    graph = StreetGraph(square(), TravelMode.WALKING)
    _, metres, path = way(graph, (10, -7), (60, 4))
    assert metres == pytest.approx(7 + 50 + 4)
    assert path.tolist() == [[10, -7], [10, 0], [60, 0], [60, 4]]


def test_who_drives_heeds_one_way_streets_and_who_walks_does_not():
    driving = StreetGraph(square(oneway=True), TravelMode.DRIVING)
    walking = StreetGraph(square(oneway=True), TravelMode.WALKING)
    assert way(driving, (10, 0), (60, 0))[0] == pytest.approx(5.0)  # 10 m/s
    assert way(driving, (60, 0), (10, 0))[1] == pytest.approx(40 + 100 + 100 + 100 + 10)
    assert way(walking, (60, 0), (10, 0))[1] == pytest.approx(50)
    assert way(driving, (60, 0), (-50, 0))[0] == np.inf
    aside_s = way(driving, (10, 0), (60, 6))[0] - 5.0
    assert aside_s == pytest.approx(6 / ASIDE_DRIVING_MPS)


def test_footways_and_motorways_are_for_some():
    paths = streets(
        [LineString([(0, 0), (100, 0)]), LineString([(0, 0), (0, 50), (100, 50), (100, 0)])],
        driving=[False, True],
        walking=[True, False],
    )
    assert way(StreetGraph(paths, TravelMode.WALKING), (0, 0), (100, 0))[1] == pytest.approx(100)
    assert way(StreetGraph(paths, TravelMode.DRIVING), (0, 0), (100, 0))[1] == pytest.approx(200)


def test_streets_join_where_one_ends_on_another_but_a_bridge_does_not():
    lines = [LineString([(0, 0), (100, 0)]), LineString([(50, 0.4), (50, 80)]), LineString([(20, -50), (20, 50)])]
    graph = StreetGraph(streets(lines), TravelMode.WALKING)
    assert way(graph, (0, 0), (50, 80))[1] == pytest.approx(130, abs=1)
    assert way(graph, (0, 0), (20, -50))[0] == np.inf


def test_what_is_far_from_every_street_is_not_reached():
    graph = StreetGraph(square(), TravelMode.WALKING)
    assert graph.place(np.array([[0.0, -5000.0]])).edge.tolist() == [-1]
    assert np.isinf(graph.durations(graph.search(graph.place(np.array([[0.0, 0.0]])), 1e4), graph.place([[5e3, 5e3]])))


def test_a_limit_bounds_the_search():
    graph = StreetGraph(square(), TravelMode.WALKING)
    assert way(graph, (-50, 0), (50, 100), limit_s=30)[0] == np.inf


def test_pieces_cover_the_streets_once():
    rng = np.random.default_rng(3)
    lines = np.array([LineString(rng.uniform(0, 300, (4, 2))) for _ in range(40)], dtype=np.object_)
    pieces = pieces_between_joints(lines)
    for row, line in enumerate(lines):
        assert shapely.length(pieces.line[pieces.street == row]).sum() == pytest.approx(line.length, rel=0.01)


def brute_force(graph, start, goal):
    """Dijkstra over a dense graph of the ends of edges with both places added."""
    a, b = graph.place(np.array([start])), graph.place(np.array([goal]))
    arcs = {}

    def link(one, other, seconds):
        arcs.setdefault(str(one), []).append((str(other), seconds))

    on_edge = {}
    for name, place in (("a", a), ("b", b)):
        on_edge.setdefault(int(place.edge[0]), []).append((float(place.along_m[0]), name))
    for edge in range(len(graph)):
        stops = [(0.0, graph.begin[edge]), *sorted(on_edge.get(edge, [])), (graph.length_m[edge], graph.end[edge])]
        for (x, one), (y, other) in pairwise(stops):
            seconds = graph.seconds[edge] * (y - x) / graph.length_m[edge]
            link(one, other, seconds)
            if graph.both_ways[edge]:
                link(other, one, seconds)
    best, heap = {}, [(0.0, 0, "a")]
    while heap:
        cost, _, node = heapq.heappop(heap)
        if node in best:
            continue
        best[node] = cost
        for other, seconds in arcs.get(node, []):
            heapq.heappush(heap, (cost + seconds, len(heap) + len(best) * 1000, other))
    return best.get("b", np.inf) + (a.aside_m[0] + b.aside_m[0]) / graph.aside_mps


@pytest.mark.parametrize("mode", list(TravelMode))
def test_every_way_is_the_quickest(mode):
    rng = np.random.default_rng(11)
    corner = np.stack(np.meshgrid(np.arange(7), np.arange(7), indexing="ij"), axis=-1) * 80.0 + rng.normal(
        0, 12, (7, 7, 2)
    )
    lines = [LineString(corner[i, j : j + 3]) for i in range(7) for j in range(0, 6, 2)]
    lines += [LineString(corner[i : i + 2, j]) for i in range(6) for j in range(7)]
    keep = rng.random(len(lines)) < 0.85
    lines = [line for line, kept in zip(lines, keep, strict=True) if kept]
    town = streets(lines, oneway=rng.random(len(lines)) < 0.4, speed_kmh=rng.choice([20.0, 30.0, 50.0], len(lines)))
    graph = StreetGraph(town, mode)
    for _ in range(60):
        start, goal = rng.uniform(0, 480, (2, 2))
        seconds, metres, path = way(graph, start, goal)
        assert seconds == pytest.approx(brute_force(graph, start, goal), rel=1e-9)
        if path is not None:
            assert np.allclose(path[[0, -1]], [start, goal], atol=1e-3)
            covered = shapely.buffer(shapely.union_all(graph.lines), 0.01)
            assert shapely.LineString(path[1:-1]).within(covered) if len(path) > 3 else True
            if mode is TravelMode.WALKING:
                assert metres / WALKING_MPS == pytest.approx(seconds, rel=1e-6)
