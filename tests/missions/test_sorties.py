"""A route as several flights: the cheapest places to split, the limits of each flight, files, and a verdict over all of them."""

import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from tests.planner.sites import flat, hills, make_site, with_scenario
from tests.verification.flights import fly_along
from uavcover.errors import InfeasibleError, InputError
from uavcover.missions.flights import compile_flights, compile_sorties
from uavcover.missions.leg_checks import find_problems
from uavcover.missions.mission_compiler import Sortie, compile_mission
from uavcover.missions.objectives import judge, mission_cost
from uavcover.missions.path_cost import check_reach
from uavcover.model.limits import NoFly
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.sensor import SphereSensor
from uavcover.model.vehicle import PowerModel, Wind
from uavcover.planner.plan_files import save_plan
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.run.documents import flown_tracks, read_planned
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.command import judge_tracks
from uavcover.verification.run_logs import planned_for

SPHERE = SphereSensor(kind="sphere", range_m=150.0, sensing="at-waypoints")


def there_and_back(site: Site, lines: int = 4, spacing_m: float = 100.0) -> Route:
    """Lines over the area, a waypoint every so many metres, 70 m above ground."""
    east = np.arange(0.0, 301.0, spacing_m)
    rows = [np.column_stack([east[:: (-1) ** k], np.full(len(east), 200.0 * k / (lines - 1))]) for k in range(lines)]
    positions = np.vstack(rows)
    return Route(np.column_stack([positions, site.ground.heights_m(positions) + 70.0]))


def flight_time_s(site: Site, points: np.ndarray) -> float:
    return compile_mission(site, Route(points), autopilot="ardupilot").flight_time_s


def cheapest(site: Site, route: Route, limit_s: float, *, shared: int) -> float:
    """Least sum of flight times, by trying every split."""
    n = len(route)
    times = {
        (a, b): flight_time_s(site, route.waypoints_m[a:b]) for a in range(n) for b in range(a + 1 + shared, n + 1)
    }
    best = math.inf
    inner = range(1, n - 1) if shared else range(1, n)
    for count in range(len(inner) + 1):
        for cuts in itertools.combinations(inner, count):
            bounds = [0, *cuts, n - shared]
            flights = [times[a, b + shared] for a, b in itertools.pairwise(bounds)]
            if max(flights) <= limit_s:
                best = min(best, sum(flights))
    return best


TURNS = {"acceleration_m_s2": 2.0}


@pytest.mark.parametrize(
    ("shared", "vehicle"), [(1, {}), (1, TURNS), (0, {})], ids=["along the path", "with turns", "at waypoints"]
)
def test_the_split_is_the_cheapest_of_all(shared: int, vehicle: dict[str, float]) -> None:
    extra: dict[str, Any] = {} if shared else {"sensor": SPHERE}
    free = make_site(hills, vehicle=vehicle, **extra)
    route = there_and_back(free, lines=3, spacing_m=150.0)
    whole_s = flight_time_s(free, route.waypoints_m)
    limit_s = 0.85 * whole_s
    site = make_site(hills, vehicle={"endurance_s": limit_s, "reserve_fraction": 0.0, **vehicle}, **extra)
    sorties = compile_sorties(site, route, autopilot="ardupilot")
    assert len(sorties) > 1
    found_s = sum(sortie.compiled.flight_time_s for sortie in sorties)
    assert found_s == pytest.approx(cheapest(free, route, limit_s, shared=shared), rel=1e-9)
    assert max(sortie.compiled.flight_time_s for sortie in sorties) <= limit_s


def round_a_bay(rng: np.random.Generator) -> tuple[tuple[tuple[float, float], ...], np.ndarray]:
    """A fence with a bay cut into it from the south, often one from the north too, and places (n, 2) round it and back.

    The first and the last place are on home's side; from behind the bay most straight ways home lead across it.
    """
    west, top = rng.uniform(0.0, 120.0), rng.uniform(100.0, 240.0)
    east = west + rng.uniform(8.0, 40.0)
    fence = shapely.box(-200.0, -150.0, 450.0, 350.0).difference(shapely.box(west, -151.0, east, top))
    near = [(rng.uniform(-180.0, west - 25.0), rng.uniform(-120.0, 300.0)) for _ in range(4)]
    positions = [*near[:2], (west - 25.0, top + 30.0), (east + 25.0, top + 30.0)]
    while len(positions) < 6:
        position = (rng.uniform(east + 15.0, 430.0), rng.uniform(-130.0, top + 60.0))
        if fence.buffer(-8.0).covers(shapely.LineString([positions[-1], position])):
            positions.append(position)
    there_and_back = np.vstack([positions, (east + 25.0, top + 40.0), (west - 25.0, top + 40.0), *near[2:]])
    another = fence.difference(
        shapely.box(*rng.uniform([150.0, 0.0], [350.0, 200.0]), rng.uniform(360.0, 430.0), 351.0)
    )
    if another.geom_type == "Polygon" and another.buffer(-8.0).covers(shapely.LineString(there_and_back)):
        fence = another
    return tuple(shapely.get_coordinates(fence.exterior)[:-1].tolist()), there_and_back


def least_of_all(site: Site, route: Route, *, shared: int) -> float:
    """Least sum of flight times of the splits that the compiler takes, by trying every one; infinite when there is none."""
    n = len(route)
    times: dict[tuple[int, int], float] = {}
    for first in range(n):
        for last in range(first + shared, n):
            try:
                times[first, last] = flight_time_s(site, route.waypoints_m[first : last + 1])
            except InfeasibleError:
                times[first, last] = math.inf
    best = [0.0] + [math.inf] * n  # of the flights before waypoint k
    for last in range(shared, n):
        best[last + 1 - shared] = min(best[first] + times[first, last] for first in range(last + 1 - shared))
    return best[n - shared]


@pytest.mark.parametrize("seed", range(30))
def test_among_the_bays_of_a_fence_the_cheapest_split_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shared = int(rng.integers(0, 2))
    extra: dict[str, Any] = {} if shared else {"sensor": SPHERE}
    fence, positions = round_a_bay(rng)
    route = Route(np.column_stack([positions, np.full(len(positions), 70.0)]))
    wide = ((-300.0, -300.0), (600.0, -300.0), (600.0, 500.0), (-300.0, 500.0))
    whole_s = flight_time_s(make_site(flat, fence=wide, **extra), route.waypoints_m)
    site = make_site(flat, fence=fence, vehicle={"endurance_s": 1.25 * rng.uniform(0.7, 0.98) * whole_s}, **extra)
    expected = least_of_all(site, route, shared=shared)
    if math.isinf(expected):
        with pytest.raises(InfeasibleError):
            compile_sorties(site, route, autopilot="ardupilot")
        return
    sorties = compile_sorties(site, route, autopilot="ardupilot")
    assert sum(s.compiled.flight_time_s for s in sorties) == pytest.approx(expected, rel=1e-9)


def test_every_leg_is_flown_by_one_sortie_and_every_way_is_checked() -> None:
    site = make_site(hills, vehicle={"endurance_s": 212.5})
    route = there_and_back(site, lines=6)
    sorties = compile_sorties(site, route, autopilot="px4")
    assert len(sorties) >= 3
    assert (sorties[0].first, sorties[-1].last) == (0, len(route) - 1)
    for a, b in itertools.pairwise(sorties):
        assert b.first == a.last
    for sortie in sorties:
        assert (sortie.route.waypoints_m == route.waypoints_m[sortie.first : sortie.last + 1]).all()
        path = sortie.compiled.path_m
        assert np.hypot(*(path[[0, -1], :2] - [-100.0, 50.0]).T).max() < 1e-6, "from home, to home"
        problems = find_problems(site, path, lowest_agl_m=20.0, highest_agl_m=None)
        assert [p for p in problems if p.kind != "climb"] == []
        assert sortie.compiled.flight_time_s <= 170.0


def test_a_route_that_fits_is_one_flight() -> None:
    site = make_site(flat)
    route = there_and_back(site)
    (only,) = compile_sorties(site, route, autopilot="ardupilot")
    assert (only.first, only.last) == (0, len(route) - 1)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_the_largest_number_of_items(autopilot: str) -> None:
    site = make_site(flat, vehicle={"max_mission_items": 12})
    route = there_and_back(site, spacing_m=50.0)
    sorties = compile_sorties(site, route, autopilot=autopilot)  # type: ignore[arg-type]
    home = 1 if autopilot == "ardupilot" else 0
    assert max(len(sortie.compiled.mission.items) + home for sortie in sorties) <= 12
    with pytest.raises(InfeasibleError, match=r"the mission has \d+ items, but vehicle\.max_mission_items is 12"):
        compile_mission(site, route, autopilot=autopilot)  # type: ignore[arg-type]


@pytest.mark.parametrize("most", [8, 10, 13])
@pytest.mark.parametrize("shared", [1, 0], ids=["along the path", "at waypoints"])
def test_a_limit_of_points_splits_where_it_costs_least(shared: int, most: int) -> None:
    extra: dict[str, Any] = {} if shared else {"sensor": SPHERE}
    site = make_site(hills, **extra)
    route = there_and_back(site, lines=3, spacing_m=100.0)
    n = len(route)
    times: dict[tuple[int, int], float] = {}
    for first in range(n):
        for last in range(first + shared, n):
            part = compile_mission(site, Route(route.waypoints_m[first : last + 1]), autopilot="ardupilot")
            if len(part.path_m) <= most:
                times[first, last] = part.flight_time_s
    best = [0.0] + [math.inf] * n
    for last in range(shared, n):
        ends = [best[first] + times[first, last] for first in range(last + 1 - shared) if (first, last) in times]
        best[last + 1 - shared] = min(ends, default=math.inf)
    sorties = compile_sorties(site, route, autopilot="ardupilot", most_points=most)
    assert len(sorties) > 1
    assert max(len(sortie.compiled.path_m) for sortie in sorties) <= most
    assert sum(s.compiled.flight_time_s for s in sorties) == pytest.approx(best[n - shared], rel=1e-9)


def test_more_items_than_the_autopilot_takes() -> None:
    site = make_site(flat)
    route = there_and_back(site, lines=20, spacing_m=7.0)
    assert len(route) > 650
    sorties = compile_sorties(site, route, autopilot="ardupilot")
    assert len(sorties) == 2
    assert max(len(sortie.compiled.mission.items) for sortie in sorties) < 650


def test_what_no_flight_reaches_is_named_with_the_amount() -> None:
    site = make_site(flat, vehicle={"endurance_s": 75.0})
    with pytest.raises(InfeasibleError) as caught:
        compile_sorties(site, there_and_back(site), autopilot="ardupilot")
    message = str(caught.value)
    assert message.startswith("the leg to waypoint ")
    assert "a sortie with this part alone takes " in message
    assert (
        "vehicle.endurance_s is 75 s, and vehicle.reserve_fraction = 0.2 allows flights of at most 60 s; move [home] nearer"
        in message
    )
    assert "\n" not in message


def saved(folder: Path, endurance_s: float) -> tuple[RunFolder, tuple[Sortie, ...], Plan]:
    """A plan of three lines over the demo's ground in a run folder, flown by a vehicle with this endurance."""
    scenario = load_scenario("jacksboro")
    vehicle = dataclasses.replace(scenario.vehicle, endurance_s=endurance_s, reserve_fraction=0.0)
    site = load_site(dataclasses.replace(scenario, vehicle=vehicle))
    corners = [[-900, 50], [-500, 50], [-100, 50], [-100, 250], [-500, 250], [-900, 250]]
    route = Route(lay_over_terrain(site, np.array(corners, float), np.full(len(corners), 80.0), tolerance_m=8.0))
    member = RouteMember(route, judge(judging_map(site), route), 0.0, "test")
    plan = Plan(member, (member,), (), "knee", True, "test", 1, 0.0)
    flights = compile_flights(site, route)
    single = flights[0].compiled if len(flights) == 1 else None
    folder.mkdir(exist_ok=True)
    save_plan(
        RunFolder(folder), site, plan, compiled=single, autopilot="ardupilot", seed=1, command=["test"],
        sorties=() if single else flights,
    )  # fmt: skip
    return RunFolder(folder), flights, plan


@pytest.mark.usefixtures("attitudes_count")
def test_each_sortie_is_a_run_folder_and_all_count_together(tmp_path: Path) -> None:
    run, sorties, plan = saved(tmp_path / "run", 290.0)
    assert len(sorties) >= 2
    assert [folder.path.name for folder in run.sorties()] == [f"sortie-{k + 1}" for k in range(len(sorties))]
    assert not run.file("mission.waypoints").exists()
    document = json.loads(run.file("plan.json").read_text())
    assert [row["folder"] for row in document["sorties"]] == [f"sortie-{k + 1}" for k in range(len(sorties))]
    assert [row["flight_time_s"] for row in document["sorties"]] == [s.compiled.flight_time_s for s in sorties]
    tracks = []
    for folder, sortie in zip(run.sorties(), sorties, strict=True):
        site, planned = read_planned(folder)
        assert (planned.route.waypoints_m == sortie.route.waypoints_m).all()
        assert len(folder.file("mission.waypoints").read_text().splitlines()) == len(sortie.compiled.mission.items) + 2
        path = sortie.compiled.path_m
        first = int(np.argmin(np.linalg.norm(path - sortie.route.waypoints_m[0], axis=1)))
        tracks.append(fly_along(site, path, first=first, count=len(sortie.route)))
        folder.file("track.csv").touch()
    judged = judge_tracks(
        site,
        [(t, planned_for(f.file("track.csv"), run)) for t, f in zip(tracks, run.sorties(), strict=True)],
    )
    # One after the other they see what the whole route sees, and are measured by what the whole plan promised.
    assert judged.report.planned_coverage_fraction == plan.chosen.metrics.coverage_fraction
    assert judged.report.coverage_fraction == pytest.approx(plan.chosen.metrics.coverage_fraction, abs=0.005)
    assert judged.report.violations == ()
    assert flown_tracks(run) == [folder.file("track.csv") for folder in run.sorties()]


def test_which_flight_is_meant_must_be_said(tmp_path: Path) -> None:
    run, sorties, _ = saved(tmp_path / "run", 290.0)
    with pytest.raises(InputError, match=rf"has {len(sorties)} sorties: add --sortie N, from 1 to {len(sorties)}"):
        run.flight(None)
    with pytest.raises(InputError, match="not sortie 9: add --sortie"):
        run.flight(9)
    assert run.flight(2).path.name == "sortie-2"
    with pytest.raises(InputError, match="is a single flight without sorties"):
        run.flight(2).flight(1)
    with pytest.raises(InputError, match=r"has no track.csv; create it with: uavcover fly --sortie 1"):
        flown_tracks(run)


def test_a_new_plan_of_one_flight_leaves_no_sortie_behind(tmp_path: Path) -> None:
    run, sorties, _ = saved(tmp_path / "run", 290.0)
    assert len(sorties) > 1
    saved(tmp_path / "run", 2600.0)
    assert run.sorties() == []
    assert run.file("mission.waypoints").is_file()
    assert not run.file("sortie-1/mission.waypoints").exists()


@pytest.mark.parametrize("sensor", [None, SPHERE], ids=["along the path", "at waypoints"])
def test_mission_time_of_one_flight_is_that_of_its_mission(sensor: SphereSensor | None) -> None:
    site = make_site(hills, **({} if sensor is None else {"sensor": sensor}))
    route = there_and_back(site)
    assert mission_cost(site, route).time_s == pytest.approx(flight_time_s(site, route.waypoints_m), rel=1e-9)


@pytest.mark.parametrize("sensor", [None, SPHERE], ids=["along the path", "at waypoints"])
def test_mission_time_of_several_flights_is_near_that_of_their_missions(sensor: SphereSensor | None) -> None:
    extra: dict[str, Any] = {} if sensor is None else {"sensor": sensor}
    route = there_and_back(make_site(hills, **extra), lines=6, spacing_m=50.0)
    site = make_site(hills, vehicle={"endurance_s": 195.0}, **extra)
    sorties = compile_sorties(site, route, autopilot="ardupilot")
    assert len(sorties) > 2
    flown_s = sum(sortie.compiled.flight_time_s for sortie in sorties)
    # The straight transits of the estimate are not those over the terrain.
    assert mission_cost(site, route).time_s == pytest.approx(flown_s, rel=0.05)
    assert judge(judging_map(site), route).mission_time_s == mission_cost(site, route).time_s


def test_mission_time_counts_the_items_of_a_mission() -> None:
    site = make_site(hills, vehicle={"max_mission_items": 16})
    route = there_and_back(site)
    sorties = compile_sorties(site, route, autopilot="ardupilot")
    assert len(sorties) > 1
    flown_s = sum(sortie.compiled.flight_time_s for sortie in sorties)
    assert mission_cost(site, route).time_s == pytest.approx(flown_s, rel=0.05)


POWER = {"hover_induced_m_s": 3.0, "descent_gain": 0.0}


@pytest.mark.parametrize("wind_m_s", [0.0, 6.0])
def test_mission_energy_is_what_its_flights_take_from_the_batteries(wind_m_s: float) -> None:
    route = there_and_back(make_site(hills), lines=6, spacing_m=50.0)
    for endurance_s, least, error in ((2600.0, 1, 1e-9), (260.0, 2, 0.05)):
        vehicle = {"endurance_s": endurance_s, "max_airspeed_m_s": 14.0, "power": PowerModel(**POWER)}
        site = with_scenario(make_site(hills, vehicle=vehicle), wind=Wind(speed_m_s=wind_m_s, from_deg=250.0))
        used = [sortie.compiled.battery_used for sortie in compile_sorties(site, route, autopilot="ardupilot")]
        assert len(used) >= least
        cost = mission_cost(site, route)
        assert cost.energy_hover_s == pytest.approx(endurance_s * math.fsum(u or 0.0 for u in used), rel=error)
        metrics = judge(judging_map(site), route)
        assert metrics.mission_energy_hover_s == cost.energy_hover_s
        frugal = dataclasses.replace(site.scenario.planner, objective="energy", waypoint_price=0.0)
        judged = judge(judging_map(with_scenario(site, planner=frugal)), route)
        assert judged.cost == pytest.approx(cost.energy_hover_s, rel=1e-9)


@pytest.mark.parametrize(("endurance_s", "required", "refused"), [(60.0, 0.5, True), (60.0, None, True), (105.0, 0.98, True),
                                                                  (105.0, 0.3, False), (300.0, 0.98, False)])  # fmt: skip
def test_an_area_out_of_reach_is_refused_before_a_search(
    endurance_s: float, required: float | None, refused: bool
) -> None:
    site = make_site(vehicle={"endurance_s": endurance_s, "reserve_fraction": 0.2}, home=(-200.0, 100.0))
    coverage = judging_map(site)
    if not refused:
        check_reach([site], coverage, required)
        return
    with pytest.raises(InfeasibleError, match=r"vehicle.endurance_s is .* move \[home\] nearer"):
        check_reach([site], coverage, required)
    # Another vehicle reaches it, or there is no limit.
    check_reach([site, make_site(vehicle={"endurance_s": 600.0})], coverage, required)
    check_reach([make_site()], coverage, required)


def test_what_flights_reach_is_not_refused() -> None:
    """The least endurance with which the whole area can be flown: its reach is not denied."""
    site = make_site(vehicle={"endurance_s": 400.0})
    route = there_and_back(site)
    least_s = max(flight.compiled.flight_time_s for flight in compile_sorties(site, route, autopilot="ardupilot"))
    exact = make_site(vehicle={"endurance_s": least_s, "reserve_fraction": 0.0})
    check_reach([exact], judging_map(exact), 1.0)


def test_an_area_that_nothing_can_see_is_refused() -> None:
    site = make_site(
        no_fly=(NoFly(polygon_east_north_m=((-90, -90), (400, -90), (400, 300), (-90, 300)), margin_m=30.0),)
    )
    with pytest.raises(InfeasibleError, match="no part of the area can be observed from within"):
        check_reach([site], judging_map(site), 0.98)
    at_waypoints = dataclasses.replace(site.scenario.sensor, sensing="at-waypoints")
    wanted = dataclasses.replace(site.scenario.requirements, looks=20, look_distance_m=9.0)
    often = with_scenario(site, sensor=at_waypoints, requirements=wanted)
    with pytest.raises(
        InfeasibleError, match=r"observed 20 times from positions 9 m apart .* check requirements\.looks,"
    ):
        check_reach([often], judging_map(site), 0.98)
