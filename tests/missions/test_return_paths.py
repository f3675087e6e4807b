"""The autopilot's own return, the rally point, and the checked way home from the air."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
import shapely

from tests.missions.compiled_routes import HOME, compiled, enu_of, route
from tests.planner.sites import hills, make_site, ridge, tower
from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.leg_checks import find_problems
from uavcover.missions.mission_compiler import compile_return
from uavcover.missions.return_advice import OwnReturns, ReturnAdvice
from uavcover.missions.transit import (
    _along,
    _climb_out_m,
    _lattice,
    check_outbound,
    check_return,
    is_too_high,
    transit,
)
from uavcover.model.limits import Obstacles
from uavcover.scenario.airspace.lattice import _UPRIGHT
from uavcover.scenario.site import Site


def ridge_between() -> Site:
    """A ridge of 100 m at 140 m east, a saddle in it south of 60 m north; home is west of it."""

    def ups(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return ridge(140.0, 100.0)(east, north) * np.clip((north - 60.0) / 20.0, 0.0, 1.0)

    return make_site(ups, vehicle={"return_height_m": 60.0}, limits={"max_climb_angle_deg": 80.0})


def lowest_along(site: Site, start: np.ndarray, up_m: float) -> float:
    assert site.home_m is not None
    path = site.home_m[:2] - start[:2]
    length = float(np.hypot(*path))
    t = np.linspace(0.0, max(0.0, 1.0 - site.scenario.vehicle.acceptance_radius_m / length), 2000)
    return float((up_m - site.ground.heights_m(start[:2] + t[:, None] * path)).min())


def _advice(site: Site, path_m: FloatArray, waypoints: int) -> ReturnAdvice:
    returns = OwnReturns(
        site=site, path_m=path_m, first_waypoint=1, waypoint_count=waypoints, autopilot="ardupilot"
    )  # fmt: skip
    return returns.advice({})


def test_return_advice_on_a_ridge() -> None:
    site = ridge_between()
    path = np.array([[-100, 50, 60], [50, 20, 60], [250, 20, 60], [250, 180, 60], [50, 180, 60], [-100, 50, 60]], float)
    advice = _advice(site, path, 4)
    # 0 and 1 look home through the saddle; 2 and the leg to 3 (which begins at 2) do not; 3 is west of the ridge.
    assert advice.unsafe_waypoints == (2, 3)
    assert advice.return_height_m == 60.0
    worst_m = min(one.value for one in advice.unsafe)
    assert worst_m == pytest.approx(60.0 - 100.0, abs=0.5)
    assert advice.safe_return_height_m == pytest.approx(120.0, abs=0.5)
    # From every place of the path, at the height that was advised, by dense sampling.
    for a, b in itertools.pairwise(path):
        for t in np.linspace(0.0, 1.0, 23):
            position = a + t * (b - a)
            if np.hypot(*(position[:2] - HOME)) < 3.0:
                continue
            assert lowest_along(site, position, max(position[2], advice.safe_return_height_m)) >= 20.0 - 0.02
            at_60 = lowest_along(site, position, max(position[2], 60.0))
            assert at_60 >= worst_m - 0.02


def test_a_ridge_seen_only_from_the_middle_of_a_leg() -> None:
    def cone(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return np.maximum(0.0, 90.0 - 2.0 * np.hypot(east - 50.0, north - 50.0))

    site = make_site(cone, vehicle={"return_height_m": 60.0})
    path = np.array([[-100, 50, 60], [200, -140, 60], [200, 240, 60], [-100, 50, 60]], float)
    ends = [lowest_along(site, point, 60.0) for point in path[1:3]]
    assert min(ends) > 20.0
    advice = _advice(site, path, 2)
    assert advice.unsafe_waypoints == (1,)
    assert min(one.value for one in advice.unsafe) == pytest.approx(-30.0, abs=1.5)
    assert advice.safe_return_height_m == pytest.approx(110.0, abs=1.5)


def test_a_safe_return_says_so() -> None:
    advice = compiled(make_site()).return_advice
    assert advice.unsafe_waypoints == ()
    assert advice.safe_return_height_m == pytest.approx(20.0, abs=0.03)
    assert advice.unsafe == ()


def test_unknown_ground_on_the_straight_way_home_is_not_safe_and_there_is_no_rally_point() -> None:
    site = make_site(lambda e, n: np.where((e > 115) & (e < 135) & (n > 80), np.nan, 0.0 * n), home=(-100.0, 200.0))
    found = compiled(site, route((0, 150, 80), (0, 50, 80), (200, 50, 80), (100, 50, 80)))
    assert found.return_advice.unsafe_waypoints == (2, 3)
    assert math.isinf(found.return_advice.safe_return_height_m)
    assert found.rally.points == ()


def test_the_rally_point_is_home_at_a_safe_height() -> None:
    site = ridge_between()
    found = compiled(site)
    (point,) = found.rally.points
    assert found.mission.home is not None
    assert (point.lat_deg, point.lon_deg) == (found.mission.home.lat_deg, found.mission.home.lon_deg)
    assert point.alt_m >= found.return_advice.safe_return_height_m > 60.0


def test_the_rally_point_at_home_does_not_raise_returns_that_are_safe() -> None:
    """It stood at 524 m above the demo's home, and a vehicle that began 3 m from there would have climbed to it."""
    found = compiled(make_site())
    (point,) = found.rally.points
    assert found.return_advice.unsafe == ()
    assert point.alt_m == found.return_advice.return_height_m


# The way home from anywhere


def return_path(site: Site, enu: tuple[float, float, float]) -> np.ndarray:
    assert site.frame is not None
    lat, lon, alt = (float(v[0]) for v in site.frame.geodetic_from_enu(enu))
    mission = compile_return(site, lat_deg=lat, lon_deg=lon, alt_amsl_m=alt)
    assert [item.command for item in mission.items] == [178, *[16] * (len(mission.items) - 2), 21]
    assert mission.home is not None
    assert mission.items[0].params[1] == site.scenario.vehicle.cruise_speed_m_s
    raised = [dataclasses.replace(item, alt_m=item.alt_m + mission.home.alt_amsl_m) for item in mission.items[1:]]
    return np.vstack([enu, enu_of(raised)])


@pytest.mark.parametrize(
    "position", [(250.0, 150.0, 90.0), (250.0, 150.0, 190.0), (-60.0, 60.0, 80.0), (-100.0, 50.0, 60.0)]
)
def test_home_from_the_air(position: tuple[float, float, float]) -> None:
    site = make_site(hills)
    path = return_path(site, position)
    problems = find_problems(site, path[:-1], lowest_agl_m=20.0 - 1e-3, highest_agl_m=None)
    assert [p for p in problems if p.kind != "climb"] == []
    assert path[-1] == pytest.approx(site.home_m, abs=1e-3)


def test_home_over_a_ridge_from_a_valley() -> None:
    site = make_site(ridge(100.0, 120.0))
    position = (200.0, 50.0, 6.0)
    path = return_path(site, position)
    assert path[1] == pytest.approx([200.0, 50.0, path[1, 2]], abs=1e-3)  # straight up first
    assert path[1, 2] >= 20.0
    problems = find_problems(site, path[1:-1], lowest_agl_m=20.0 - 1e-3, highest_agl_m=None)
    assert [p for p in problems if p.kind != "climb" or p.value > p.limit + 1e-3] == []  # heights are in millimetres
    assert path[:, 2].max() >= 140.0


def test_home_from_low_in_the_column_above_home() -> None:
    path = return_path(make_site(), (*HOME, 4.0))
    assert path[-1] == pytest.approx([*HOME, 0.0], abs=1e-3)


def test_the_first_leg_home_is_checked_too() -> None:
    site = make_site()
    assert site.frame is not None
    lat, lon, alt = (float(v[0]) for v in site.frame.geodetic_from_enu((900.0, 50.0, 60.0)))
    with pytest.raises(InfeasibleError, match=r"the return transit: leg to waypoint 1: .* outside the fence"):
        compile_return(site, lat_deg=lat, lon_deg=lon, alt_amsl_m=alt)


def test_a_transit_that_would_be_too_high_leads_past_what_makes_it_so() -> None:
    """A tower stands at the edge of a pit on the straight way: over both at once it is 195 m above the pit, of 150 m allowed."""

    def pit(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return np.where((np.abs(east - 70.0) < 22.0) & (np.abs(north - 80.0) < 60.0), -80.0, 0.0)

    between = Obstacles(prisms=(tower(28.0, 55.0, 38.0, 65.0, 85.0),))
    site = make_site(pit, obstacles=between, limits={"max_transit_height_agl_m": 150.0, "height_margin_m": 2.0})
    home, end = np.array([-100.0, 50.0]), np.array([180.0, 70.0, 60.0])
    points = transit(site, home, end, ground_end_height_m=30.0)
    assert find_problems(site, points, lowest_agl_m=20.0, highest_agl_m=148.0) == []
    assert len(points) > 2
    np.testing.assert_array_equal(points[-1], end)
    straight = shapely.LineString([home, end[:2]])
    assert straight.distance(shapely.Point(points[:, :2][np.argmax(np.abs(points[:, 1] - 60.0))])) > 5.0
    # Without the pit it is straight, over the tower.
    over = transit(make_site(obstacles=between), home, end, ground_end_height_m=30.0)
    assert max(straight.distance(shapely.Point(position)) for position in over[:, :2]) < 1e-6
    # Where nothing is low enough it stays straight, and the check says what is in the way.
    wall = Obstacles(prisms=(tower(28.0, -400.0, 38.0, 600.0, 85.0),))
    everywhere = make_site(obstacles=wall, limits={"max_transit_height_agl_m": 58.0, "max_height_agl_m": 56.0})
    high = transit(everywhere, home, np.array([180.0, 70.0, 75.0]), ground_end_height_m=70.0)
    assert max(straight.distance(shapely.Point(position)) for position in high[:, :2]) < 1e-6


@pytest.mark.parametrize("seed", [0, 1, 4, 5])
def test_over_ground_that_is_steeper_than_legs_may_be_transits_stay_below_their_ceiling(seed: int) -> None:
    """Straight ones do not: a leg may climb by 8 degrees only."""
    rng = np.random.default_rng(seed)
    waves = rng.uniform(-1.0, 1.0, (12, 2)) / 40.0

    def steep(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return sum(14.0 * np.sin(e * east + n * north + k) for k, (e, n) in enumerate(waves))

    limits = {"max_height_agl_m": 60.0, "max_climb_angle_deg": 8.0, "max_transit_height_agl_m": 80.0}
    site = make_site(steep, limits=limits)
    assert site.home_m is not None
    too_high = 0
    for position in rng.uniform((0.0, 0.0), (300.0, 200.0), (12, 2)):
        end = np.array([*position, *site.ground.ups_m(position, 50.0)])
        points = transit(site, site.home_m[:2], end, ground_end_height_m=30.0)
        check_outbound(site, points)
        check_return(site, points[::-1])
        np.testing.assert_array_equal(points[-1], end)
        too_high += is_too_high(site, _along(site, points[[0, -1], :2], end, 30.0))
    assert too_high > 0


@pytest.mark.parametrize("seed", range(4))
def test_a_path_over_the_lattice_is_the_shortest_over_all_of_its_links(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against a search in one graph of the lattice and both columns."""
    rng = np.random.default_rng(seed)
    site = make_site(lambda east, north: 60.0 * np.sin(east / 40.0 + seed) * np.cos(north / 35.0))
    assert site.home_m is not None
    lattice, columns = _lattice(site), []
    for spot_m in (site.home_m[:2], rng.uniform([0.0, 0.0], [300.0, 200.0])):
        columns.append(_climb_out_m(site, np.array([*spot_m, *site.ground.ups_m(spot_m, rng.uniform(30.0, 60.0))])))
    positions_m, links, lengths_m = lattice.linked_with(np.vstack(columns), np.zeros((0, 2), dtype=np.int64))
    begin = len(lattice.positions_m)
    end = begin + len(columns[0])
    edges = dict(zip(map(tuple, links.tolist()), lengths_m.tolist(), strict=True))
    for first, last in ((begin, end), (end, len(positions_m))):
        for k in range(first + 1, last):
            edges[first, k] = _UPRIGHT * abs(positions_m[k, 2] - positions_m[first, 2])
    shortest = np.full(len(positions_m), np.inf)
    shortest[begin] = 0.0
    while True:  # Bellman and Ford
        before = shortest.copy()
        for (a, b), length in edges.items():
            shortest[a], shortest[b] = min(shortest[a], shortest[b] + length), min(shortest[b], shortest[a] + length)
        if (before == shortest).all():
            break
    monkeypatch.setattr(lattice, "with_few_corners", lambda path_m: path_m)
    for _ in range(2):  # found, and kept
        path_m = lattice.path(*columns)
        assert path_m is not None
        legs_m = np.diff(path_m, axis=0)
        upright = np.hypot(*legs_m[:, :2].T) == 0.0
        found = _UPRIGHT * abs(path_m[0, 2] - columns[0][0, 2])
        found += np.linalg.norm(legs_m[~upright], axis=1).sum() + _UPRIGHT * np.abs(legs_m[upright, 2]).sum()
        assert found == pytest.approx(shortest[end])
    np.testing.assert_array_equal(path_m[-1], columns[1][0])
