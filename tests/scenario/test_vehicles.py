"""Pads, sites and parts of the area of a scenario's vehicles."""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from tests.cli.conftest import corner_of_the_demo
from tests.missions.test_leg_checks import tower
from tests.planner.sites import flat, make_site
from uavcover.errors import ScenarioError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import Area, Outline
from uavcover.model.limits import Home, NoFly, Obstacles
from uavcover.model.vehicle import Fleet, Vehicle
from uavcover.scenario.scenario_file import dump_scenario, load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import groups_of, on_pads, own_parts, vehicle_sites

HOME = np.array([-100.0, 50.0])


def fleet_of(site: Site, vehicles: int, **changes: Any) -> Site:
    return dataclasses.replace(
        site, scenario=dataclasses.replace(site.scenario, fleet=Fleet(vehicles=vehicles, **changes))
    )


def pads_of(site: Site) -> FloatArray:
    homes = [vehicle.home for vehicle in on_pads(site).scenario.vehicles]
    return np.array([[home.east_m, home.north_m] for home in homes if home is not None], dtype=float)


def refusal(site: Site) -> str:
    with pytest.raises(ScenarioError) as refused:
        on_pads(site)
    return str(refused.value)


@pytest.mark.parametrize("vehicles", [2, 3, 4, 7, 8, 20, 50])
def test_pads_are_apart_and_the_first_is_home(vehicles: int) -> None:
    site = fleet_of(make_site(), vehicles)
    pads = pads_of(site)
    assert len(pads) == vehicles
    assert np.array_equal(pads[0], HOME)
    nearest_m = min(float(np.hypot(*(a - b))) for a, b in itertools.combinations(pads, 2))
    assert 46.0 < nearest_m < 46.02
    assert np.hypot(*(pads - HOME).T).max() <= 46.02 * math.hypot(4.0, vehicles // 9)


def test_the_first_pads_lie_across_the_way_to_the_area() -> None:
    site = fleet_of(make_site(), 9)
    middle = site.area.centroid
    away = np.array([middle.x, middle.y]) - HOME
    assert np.allclose((pads_of(site) - HOME) @ away, 0.0, atol=0.5)


def test_a_pad_is_moved_back_from_a_slope_so_that_paths_still_fan_out() -> None:
    # To the north-west of home, where the second pad would be.
    site = fleet_of(make_site(lambda e, n: 0.5 * np.maximum(e + 120.0, 0.0) * (n > 60.0)), 2)
    (home, pad), middle = pads_of(site), site.area.centroid
    ahead = np.array([middle.x, middle.y]) - HOME
    across = np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)
    assert abs((pad - home) @ across) == pytest.approx(46.01, abs=0.01)


def test_given_homes_and_one_home_stay_as_they_are() -> None:
    alone = fleet_of(make_site(), 1)
    assert on_pads(alone) is alone
    shared = fleet_of(make_site(), 3, pad_spacing_m=0.0)
    assert on_pads(shared) is shared
    padded = on_pads(fleet_of(make_site(), 3))
    assert on_pads(padded) is padded
    no_home = fleet_of(make_site(home=None), 2)
    assert on_pads(no_home) is no_home
    nowhere = fleet_of(make_site(on_earth=False), 2)
    assert on_pads(nowhere) is nowhere


def test_another_distance() -> None:
    near = make_site(limits={"max_home_error_m": 2.0})
    pads = pads_of(fleet_of(near, 7, pad_spacing_m=30.0))
    nearest_m = min(float(np.hypot(*(a - b))) for a, b in itertools.combinations(pads, 2))
    assert 30.0 < nearest_m < 30.02
    text = refusal(fleet_of(make_site(), 7, pad_spacing_m=30.0))
    assert "fleet.pad_spacing_m: 30 is below" in text
    assert "= 46; increase it, lower max_home_error_m" in text


BESIDE = ((-150.0, 70.0), (-50.0, 70.0), (-50.0, 300.0), (-150.0, 300.0))
NORTH = shapely.box(-600.0, 55.0, 1000.0, 1000.0)


@pytest.mark.parametrize(
    ("blocked", "why", "forbidden", "away_m"),
    [
        ({"ups": lambda e, n: np.where(n > 55.0, 0.6 * (n - 55.0), 0.0) + 0.0 * e}, "slopes by", NORTH, 0.1),
        (
            {"obstacles": Obstacles(prisms=(tower(-150, 70, -50, 300, 8.0),), clearance_beside_m=10.0)},
            "obstacle",
            shapely.Polygon(BESIDE),
            10.0,
        ),
        ({"no_fly": (NoFly(name="Z", polygon_east_north_m=BESIDE, margin_m=5),)}, "'Z'", shapely.Polygon(BESIDE), 5.0),
        ({"fence": ((-200, -60), (400, -60), (400, 73), (-200, 73))}, "fence", shapely.box(-600, 73, 1000, 1000), 3.0),
    ],
)
def test_pads_keep_away_from_slopes_obstacles_zones_and_the_fence(
    blocked: dict[str, Any], why: str, forbidden: shapely.Polygon, away_m: float
) -> None:
    def nearest_m(pads: FloatArray) -> float:
        return min(float(shapely.distance(forbidden, shapely.Point(pad))) for pad in pads)

    assert nearest_m(pads_of(fleet_of(make_site(), 7))) <= away_m
    ups = blocked.pop("ups", flat)
    site = fleet_of(make_site(ups, **blocked), 7)
    pads = pads_of(site)
    assert len(pads) == 7
    assert nearest_m(pads) >= away_m
    assert min(float(np.hypot(*(a - b))) for a, b in itertools.combinations(pads, 2)) > 46.0
    narrow = dataclasses.replace(site, fence=site.fence.intersection(shapely.Point(HOME).buffer(60.0)))
    text = refusal(narrow)
    assert why in text
    assert "of 7 pads 46 m apart" in text


def test_a_zone_above_the_pads_does_not_matter() -> None:
    above = NoFly(name="Z", polygon_east_north_m=((-150, 72), (-50, 72), (-50, 120), (-150, 120)), floor_agl_m=90.0)
    assert np.allclose(pads_of(fleet_of(make_site(no_fly=(above,)), 7)), pads_of(fleet_of(make_site(), 7)))


def test_a_steep_slope_has_no_room_and_says_what_to_do() -> None:
    site = fleet_of(make_site(lambda e, n: 0.5 * e + 0.0 * n), 3)
    text = refusal(site)
    assert "fleet.vehicles: beside [home] there is room for only 1 of 3 pads 46 m apart" in text
    assert "the ground at a pad slopes by 27 degrees, but fleet.max_pad_slope_deg is 15" in text
    assert "fleet.pad_spacing_m = 0" in text
    assert len(pads_of(fleet_of(make_site(lambda e, n: 0.5 * e + 0.0 * n), 3, max_pad_slope_deg=30.0))) == 3


def test_links_are_left_to_the_command_line() -> None:
    own = make_site(vehicle={"link": "udp:127.0.0.1:14550", "system_id": 3})
    padded = on_pads(fleet_of(own, 2)).scenario
    assert [vehicle.link for vehicle in padded.vehicles] == [None, None]
    mock = on_pads(fleet_of(make_site(vehicle={"link": "mock:ardupilot"}), 2)).scenario
    assert [vehicle.link for vehicle in mock.vehicles] == ["mock:ardupilot"] * 2


def test_a_scenario_on_pads_is_written_and_read_again(tmp_path: Path) -> None:
    site = load_site(corner_of_the_demo(tmp_path)).flown_by(3)
    padded = on_pads(site)
    written = tmp_path / "padded.toml"
    written.write_text(dump_scenario(padded.scenario))
    again = load_scenario(written)
    assert again == padded.scenario
    own = vehicle_sites(load_site(again))
    positions = np.array([each.home_m for each in own])
    assert np.allclose(positions[0], site.home_m)
    assert min(float(np.hypot(*(a - b)[:2])) for a, b in itertools.combinations(positions, 2)) > 45.9
    assert [each.scenario.home for each in own] == [vehicle.home for vehicle in padded.scenario.vehicles]
    assert isinstance(again.home, Home)
    assert again.home.lat_deg == site.scenario.home.lat_deg  # type: ignore[union-attr]


AREA = (0.0, 0.0, 300.0, 200.0)
HOLE = shapely.box(100.0, 50.0, 120.0, 70.0)


def box(west: float, south: float, east: float, north: float) -> tuple[tuple[float, float], ...]:
    return ((west, south), (east, south), (east, north), (west, north))


def reported(parts: Sequence[tuple[float, float, float, float] | None], *, margin_m: float = 0.0) -> Site:
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


def refusal_of(*parts: tuple[float, float, float, float] | None) -> str:
    with pytest.raises(ScenarioError) as refused:
        own_parts(reported(parts))
    return str(refused.value)


def test_who_sees_what_together():
    assert groups_of(reported([None, None]).scenario) == ()
    assert groups_of(reported([None, (0.0, 0.0, 100.0, 200.0), None]).scenario) == ((1, 3), (2,))
    assert groups_of(reported([(0.0, 0.0, 100.0, 200.0), None]).scenario) == ((1,), (2,))


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
    site = reported(parts, margin_m=margin_m)
    shared = own_parts(site)
    assert sorted(shared.of_vehicle) == [k for k, part in enumerate(parts, start=1) if part is not None]
    assert (shared.rest is None) == (None not in parts)
    pieces = [*shared.of_vehicle.values(), *([] if shared.rest is None else [shared.rest])]
    assert sum(piece.area for piece in pieces) == pytest.approx(site.area.area)
    assert shapely.union_all(pieces).symmetric_difference(site.area).area == pytest.approx(0.0, abs=1e-6)
    # Where a vehicle was told to see, and no other vehicle was, it sees.
    for number, piece in shared.of_vehicle.items():
        inside = shapely.box(*parts[number - 1]).intersection(shapely.box(*AREA)).difference(HOLE)
        assert inside.buffer(-0.6).difference(piece).area == pytest.approx(0.0, abs=1e-6)


def test_the_margin_belongs_to_what_it_lies_beside():
    shared = own_parts(reported([None, (0.0, 0.0, 100.0, 200.0)], margin_m=15.0))
    assert shared.of_vehicle[2].bounds == pytest.approx((-15.0, -15.0, 115.0, 215.0))
    assert shared.of_vehicle[2].intersection(shapely.box(100.0, 0.0, 300.0, 200.0)).area == pytest.approx(0.0)
    assert shared.rest is not None
    assert shared.rest.bounds == pytest.approx((100.0, -15.0, 315.0, 215.0))


def test_parts_that_do_not_fit_are_refused_by_name_and_amount():
    assert refusal_of((0.0, 0.0, 120.0, 200.0), (100.0, 0.0, 300.0, 200.0)) == (
        "vehicle.0.area and vehicle.1.area: these areas overlap by 3600 square metres; "
        "move a border so that each part of [area] belongs to one vehicle"
    )
    assert "vehicle.1.area: this area lies outside [area], 100 m away" in refusal_of(None, (400.0, 0.0, 500.0, 200.0))
    assert "vehicle.1.area: 20000 of the 40000 square metres lie outside [area]" in refusal_of(
        None, (200.0, 0.0, 400.0, 200.0)
    )
    assert "vehicle.2: the others cover the whole [area]" in refusal_of(
        (0.0, 0.0, 150.0, 200.0), (150.0, 0.0, 300.0, 200.0), None
    )
    assert "vehicle.0.area to vehicle.1.area: no vehicle covers 19600 square metres of [area]" in refusal_of(
        (0.0, 0.0, 100.0, 200.0), (200.0, 0.0, 300.0, 200.0)
    )
    assert "vehicle.1.area: this area is at most 1 m wide" in refusal_of(None, (0.0, 0.0, 0.5, 200.0))
    # A part that is a hole of the area is nothing to see.
    assert "vehicle.1.area: this area is at most 1 m wide inside [area]" in refusal_of(None, HOLE.bounds)
