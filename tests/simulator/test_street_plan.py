import numpy as np
import pytest
from shapely import LineString, union_all

from autowaze.simulator import PRESETS, load_description
from autowaze.simulator.plan.street_plan import plan_street
from autowaze.world.errors import AutowazeError
from autowaze.world.parking import ParkingMap


@pytest.mark.parametrize("street", ["town-a", "town-b"])
def test_the_streets_of_the_town_have_fifteen_spots(street: str) -> None:
    assert len(plan_street(load_description(street)).bays) == 15


@pytest.mark.parametrize("street", PRESETS)
def test_bays_lie_on_asphalt_beside_the_route_and_not_on_each_other(street: str) -> None:
    plan = plan_street(load_description(street))
    bays = [bay.polygon for bay in plan.bays]
    assert all(plan.asphalt.buffer(0.05).contains(bay) for bay in bays)
    assert sum(bay.area for bay in bays) == pytest.approx(union_all(bays).area, rel=0.01)
    driven = LineString(plan.route.points).buffer(1.0, cap_style="flat")
    assert plan.asphalt.contains(driven)
    assert not any(driven.intersects(bay) for bay in bays)


def test_the_parking_map_survives_its_file() -> None:
    plan = plan_street(load_description("stewart"))
    read = ParkingMap.from_document(plan.parking_geojson(), "stewart")
    for spot, bay in zip(read.spots, plan.bays, strict=True):
        assert (spot.id, spot.kind) == (bay.id, bay.kind)
        assert np.allclose(spot.centre, bay.centre, atol=0.01)


def test_a_block_is_driven_round_to_where_it_began() -> None:
    plan = plan_street(load_description("loop"))
    assert plan.loops
    assert plan.route.length >= 400.0
    again = plan.route.at(np.arange(plan.route.length - 22.0, plan.route.length, 0.5))
    begin = plan.route.at(np.arange(0.0, 30.0, 0.25))
    assert np.linalg.norm(again[:, None] - begin, axis=2).min(axis=1).max() < 0.5


def test_seeds_lay_out_different_rows() -> None:
    def kinds(seed: int) -> list[str]:
        return [bay.kind for bay in plan_street(load_description("loop", seed=seed)).bays]

    assert kinds(1) == kinds(1)
    assert kinds(1) != kinds(2)


def test_a_row_that_does_not_fit_is_refused() -> None:
    with pytest.raises(AutowazeError, match="there are 59 m"):
        plan_street(load_description("town-a", rows=[{"count": 30}]))
