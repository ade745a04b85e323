"""Vehicles that are merged as boxes come and go, against merging all boxes at once, shapely by shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from street import Street

from autowaze.cloud.box_overlap import leaders_and_clusters
from autowaze.cloud.evidence import MOST_WITNESSES, evidence_of
from autowaze.cloud.ground_votes import GroundVotes
from autowaze.cloud.merging import merge_boxes
from autowaze.cloud.parked_vehicles import GRAZING_OVERLAP, ParkedVehicles
from autowaze.cloud.spots import SpotIndex
from autowaze.cloud.witnesses import Witnesses
from autowaze.world.identity import INSTANCE_BITS
from autowaze.world.parking import ParkingSpot
from autowaze.world.vehicles import VehicleBoxes

STREET = Street(count=8)


def _boxes(rng: np.random.Generator, groups: list[int]) -> VehicleBoxes:
    """Each group has a box or two, about the same few places, some across."""
    group = np.array([group for group in groups for _ in range(rng.integers(1, 3))], np.uint64)
    count = len(group)
    places = np.array([STREET.centre(spot) for spot in range(STREET.count)])
    return VehicleBoxes(
        centre=places[rng.integers(0, 6, count)] + rng.normal(0, 0.6, (count, 2)),
        length=rng.uniform(3.5, 5.5, count),
        width=rng.uniform(1.6, 2.2, count),
        heading=STREET.heading + rng.choice([0.0, np.pi / 2], count, p=[0.9, 0.1]) + rng.normal(0, 0.05, count),
        group=group,
        label=np.full(count, 2, np.uint8),
        confidence=rng.random(count),
        points=rng.integers(4, 12, count),
        seen_at=rng.uniform(0, 100, count),
    )


@pytest.mark.parametrize("seed", range(10))
def test_leaders_and_clusters_are_those_of_all_pairs(seed: int) -> None:
    boxes = _boxes(np.random.default_rng(seed), list(range(1, 30)))
    polygons, area = boxes.polygons, boxes.length * boxes.width
    common = shapely.area(shapely.intersection(polygons[:, None], polygons))
    similar = common / (area[:, None] + area - common) >= 0.3
    leader = np.full(len(boxes), -1)
    for row in range(len(boxes)):
        if leader[row] < 0:
            leader[similar[row] & (leader < 0)] = row
    linked = np.linalg.matrix_power(similar.astype(float), len(boxes)) > 0
    found, cluster = leaders_and_clusters(boxes.corners, 0.3)
    np.testing.assert_array_equal(found, leader)
    np.testing.assert_array_equal(cluster, linked.argmax(axis=1))


@pytest.mark.parametrize("seed", range(10))
def test_boxes_that_come_and_go_give_the_vehicles_of_all_that_stay(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spots = SpotIndex(STREET.parking_map)
    parked, held = ParkedVehicles(spots), {}
    for _ in range(30):
        groups = rng.choice(np.arange(1, 25), rng.integers(1, 5), replace=False).astype(np.uint64)
        boxes = _boxes(rng, [group for group in groups.tolist() if rng.random() < 0.6])
        if len(boxes) == 0:
            boxes = VehicleBoxes.empty()
        parked.replace(groups, boxes)
        held.update({group: boxes[boxes.group == np.uint64(group)] for group in groups.tolist()})
        vehicles = merge_boxes(VehicleBoxes.concatenate([held[group] for group in sorted(held)]))
        footprints = vehicles.polygons
        common = shapely.area(shapely.intersection(footprints[:, None], spots.polygons))
        share = common / (vehicles.length * vehicles.width)[:, None]
        around = parked.around(np.arange(len(spots)))
        for spot, here in around.items():
            meets = np.flatnonzero(shapely.intersects(footprints, spots.polygons[spot]))
            expected = sorted(zip(vehicles.group[meets].tolist(), share[meets, spot].tolist(), strict=True))
            found = sorted((vehicle.group, vehicle.shares[spot]) for vehicle in here)
            assert [group for group, _ in found] == [group for group, _ in expected]
            np.testing.assert_allclose([s for _, s in found], [s for _, s in expected], atol=1e-9)
            at_home = [row for row in meets if share[row].argmax() == spot and share[row, spot] >= GRAZING_OVERLAP]
            assert sorted(v.group for v in here if v.home == spot) == sorted(vehicles.group[at_home].tolist())


def test_vehicles_are_placed_again_when_a_spot_is_drawn_or_erased() -> None:
    spots = SpotIndex(STREET.parking_map)
    parked = ParkedVehicles(spots)
    boxes = _boxes(np.random.default_rng(0), [1])[:1]
    boxes.centre[0] = STREET.centre(3)
    boxes.heading[0] = STREET.heading
    parked.replace(boxes.group, boxes)
    assert [v.home for v in parked.around(np.array([3]))[3]] == [3]
    spots.erase("S0")
    assert parked.around(np.array([3]))[3] == []
    assert [v.home for v in parked.around(np.array([2]))[2]] == [2]
    spots.erase("S3")
    row = spots.draw(ParkingSpot("own", boxes.polygons[0]))
    assert [v.home for v in parked.around(np.array([row]))[row]] == [row]


def test_of_a_crowd_of_witnesses_the_newest_speak() -> None:
    spots = SpotIndex(STREET.parking_map)
    parked = ParkedVehicles(spots)
    one = _boxes(np.random.default_rng(0), [1])[np.zeros(MOST_WITNESSES + 9, np.int64)]
    one.centre[:] = STREET.centre(3)
    one.heading[:] = STREET.heading
    one.group = (np.arange(1, len(one) + 1, dtype=np.uint64) << np.uint64(INSTANCE_BITS)) + np.uint64(1)
    one.seen_at = np.arange(len(one), dtype=np.float64)
    for row in np.random.default_rng(1).permutation(len(one)):
        parked.replace(one.group[row : row + 1], one[row : row + 1])
    (evidence,) = evidence_of(np.array([3]), spots, parked, GroundVotes(spots), Witnesses())
    assert sorted(item.observed_at for item in evidence) == one.seen_at[-MOST_WITNESSES:].tolist()
