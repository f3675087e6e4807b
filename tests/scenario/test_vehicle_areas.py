"""Parts of the area that vehicles of a fleet were told, in metres beside each other."""

import dataclasses
from collections.abc import Sequence

import pytest
import shapely

from tests.planner.sites import make_site
from uavcover.errors import ScenarioError
from uavcover.model.area import Area, Outline
from uavcover.model.vehicle import Fleet, Vehicle
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import groups_of, own_parts

AREA = (0.0, 0.0, 300.0, 200.0)
HOLE = shapely.box(100.0, 50.0, 120.0, 70.0)


def box(west: float, south: float, east: float, north: float) -> tuple[tuple[float, float], ...]:
    return ((west, south), (east, south), (east, north), (west, north))


def told(parts: Sequence[tuple[float, float, float, float] | None], *, margin_m: float = 0.0) -> Site:
    """A site of 300 m by 200 m with a hole, whose vehicles have these parts."""
    site = make_site(ring=box(*AREA), holes=(box(*HOLE.bounds),))
    vehicles = tuple(
        Vehicle(home=site.scenario.home, area=None if part is None else Outline(polygon_east_north_m=box(*part)))
        for part in parts
    )
    area = Area(cell_size_m=10.0, polygons_east_north_m=((box(*AREA), box(*HOLE.bounds)),), margin_m=margin_m)
    scenario = dataclasses.replace(
        site.scenario, area=area, vehicles=vehicles, fleet=Fleet(vehicles=len(vehicles)), vehicle=Vehicle()
    )
    grown = shapely.box(*AREA).buffer(margin_m, join_style="mitre").difference(HOLE)
    return dataclasses.replace(site, scenario=scenario, area=grown)


def refusal(*parts: tuple[float, float, float, float] | None) -> str:
    with pytest.raises(ScenarioError) as refused:
        own_parts(told(parts))
    return str(refused.value)


def test_who_sees_what_together():
    assert groups_of(told([None, None]).scenario) == ()
    assert groups_of(told([None, (0.0, 0.0, 100.0, 200.0), None]).scenario) == ((1, 3), (2,))
    assert groups_of(told([(0.0, 0.0, 100.0, 200.0), None]).scenario) == ((1,), (2,))


@pytest.mark.parametrize("margin_m", [0.0, 15.0])
@pytest.mark.parametrize(
    "parts",
    [
        [None, (0.0, 0.0, 100.0, 200.0)],
        [(0.0, 0.0, 100.0, 200.0), (100.0, 0.0, 300.0, 200.0)],
        # Drawn by hand: half a metre over each other, or apart, and over the edge of the area.
        [(-0.4, -0.4, 100.4, 200.4), (100.0, 0.0, 200.0, 200.0), (200.5, 0.0, 300.0, 200.0)],
        [(40.0, 40.0, 80.0, 80.0), None, None],
    ],
)
def test_parts_are_together_the_area_and_lie_beside_each_other(parts, margin_m):
    site = told(parts, margin_m=margin_m)
    shared = own_parts(site)
    assert sorted(shared.of_vehicle) == [k for k, part in enumerate(parts, start=1) if part is not None]
    assert (shared.rest is None) == (None not in parts)
    pieces = [*shared.of_vehicle.values(), *([] if shared.rest is None else [shared.rest])]
    assert sum(piece.area for piece in pieces) == pytest.approx(site.area.area)
    assert shapely.union_all(pieces).symmetric_difference(site.area).area == pytest.approx(0.0, abs=1e-6)
    # Where a vehicle was told to see, and nobody else was, it sees.
    for number, piece in shared.of_vehicle.items():
        inside = shapely.box(*parts[number - 1]).intersection(shapely.box(*AREA)).difference(HOLE)
        assert inside.buffer(-0.6).difference(piece).area == pytest.approx(0.0, abs=1e-6)


def test_the_margin_belongs_to_what_it_lies_beside():
    shared = own_parts(told([None, (0.0, 0.0, 100.0, 200.0)], margin_m=15.0))
    assert shared.of_vehicle[2].bounds == pytest.approx((-15.0, -15.0, 115.0, 215.0))
    assert shared.of_vehicle[2].intersection(shapely.box(100.0, 0.0, 300.0, 200.0)).area == pytest.approx(0.0)
    assert shared.rest is not None
    assert shared.rest.bounds == pytest.approx((100.0, -15.0, 315.0, 215.0))


def test_parts_that_do_not_fit_are_refused_by_name_and_amount():
    assert refusal((0.0, 0.0, 120.0, 200.0), (100.0, 0.0, 300.0, 200.0)) == (
        "vehicle.0.area and vehicle.1.area: these areas overlap by 3600 square metres; "
        "move a border so that each part of [area] belongs to one vehicle"
    )
    assert "vehicle.1.area: this area lies outside [area], 100 m away" in refusal(None, (400.0, 0.0, 500.0, 200.0))
    assert "vehicle.1.area: 20000 of the 40000 square metres lie outside [area]" in refusal(
        None, (200.0, 0.0, 400.0, 200.0)
    )
    assert "vehicle.2: the others cover the whole [area]" in refusal(
        (0.0, 0.0, 150.0, 200.0), (150.0, 0.0, 300.0, 200.0), None
    )
    assert "vehicle.0.area to vehicle.1.area: no vehicle covers 19600 square metres of [area]" in refusal(
        (0.0, 0.0, 100.0, 200.0), (200.0, 0.0, 300.0, 200.0)
    )
    assert "vehicle.1.area: this area is at most 1 m wide" in refusal(None, (0.0, 0.0, 0.5, 200.0))
    # A part that is a hole of the area is nothing to see.
    assert "vehicle.1.area: this area is at most 1 m wide inside [area]" in refusal(None, HOLE.bounds)
