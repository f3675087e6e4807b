import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from pymavlink import mavwp

from mission_io.formats import plan as plan_format
from mission_io.formats import wpl
from mission_io.model.items import Command, Frame, MissionItem, same_item
from tests.missions.compiled_routes import HOME, amsl, compiled, enu_of, route, sensing_route
from tests.planner.sites import ORIGIN, flat, hills, make_site, ridge, tower, with_scenario
from uavcover.errors import InfeasibleError, InputError
from uavcover.missions.flights import export_text
from uavcover.missions.leg_checks import find_problems
from uavcover.missions.mission_compiler import compile_mission
from uavcover.missions.transit import transit
from uavcover.model.limits import Obstacles
from uavcover.model.route import Route
from uavcover.model.vehicle import PowerModel, Wind


def test_the_items_in_their_order() -> None:
    site = make_site(hills, vehicle={"cruise_speed_m_s": 7.0})
    planned = sensing_route(site)
    found = compiled(site, planned)
    items = found.mission.items
    assert items[0].command == Command.NAV_TAKEOFF
    assert items[1].command == Command.DO_CHANGE_SPEED
    assert items[1].params[:2] == (1.0, 7.0)
    assert items[-1].command == Command.NAV_LAND
    assert items[-1].alt_m == 0.0
    assert {item.command for item in items[2:-1]} == {16}
    assert {item.frame for item in items if item.has_position} == {Frame.ABOVE_HOME}
    assert found.waypoint_count == len(planned)
    # Against pyproj, not against our own frame: places and heights above home, which are in whole millimetres.
    positions = enu_of(amsl(found))
    near = np.array([1e-4, 1e-4, 1.1e-3])
    heights_m = [item.alt_m for item in items] + [found.mission.home.alt_amsl_m if found.mission.home else 0.0]
    assert [round(height_m, 3) for height_m in heights_m] == heights_m
    rows = slice(found.first_waypoint_item, found.first_waypoint_item + found.waypoint_count)
    assert (abs(positions[rows] - planned.waypoints_m) <= near).all()
    with_position = [0, *range(2, len(items) - 1)]
    assert (abs(positions[with_position] - found.path_m) <= near).all()
    assert site.home_m is not None
    assert (abs(positions[-1] - site.home_m) <= near).all()
    assert np.hypot(*(found.path_m[[0, -1], :2] - HOME).T) == pytest.approx(0.0, abs=1e-9)
    highest_m = max(i.alt_m for i in items if i.has_position)
    assert found.max_height_above_home_m == pytest.approx(highest_m, abs=6e-4)


@pytest.mark.parametrize("margin_m", [0.0, 8.0])
@pytest.mark.parametrize(
    "ups", [flat, hills, ridge(-50.0, 90.0), ridge(-48.0, 70.0, 15.0)], ids=["flat", "hills", "ridge", "wall"]
)
def test_every_leg_of_the_whole_path_is_clear_at_full_length(ups, margin_m: float) -> None:  # type: ignore[no-untyped-def]
    site = make_site(ups, limits={"height_margin_m": margin_m, "max_climb_angle_deg": 45.0})
    found = compiled(site)
    first = found.first_waypoint_item - 1  # the speed change is not a place
    count = found.waypoint_count
    there, back = found.path_m[: first + 1], found.path_m[first + count - 1 :]
    planned = found.path_m[first : first + count]
    assert find_problems(site, planned, lowest_agl_m=40.0, highest_agl_m=120.0) == []
    for path in (there, back):
        problems = find_problems(site, path, lowest_agl_m=20.0 + margin_m, highest_agl_m=None)
        assert [p for p in problems if p.kind != "climb"] == []
        assert all(np.hypot(*(path[p.leg] - path[p.leg - 1])[:2]) < 0.1 for p in problems)  # columns only


def test_a_hill_between_home_and_area_lifts_the_transit() -> None:
    low = compiled(make_site(flat))
    # Straight over the valley before the hill the way is higher above ground than it may be by default; a longer one is not.
    longer = make_site(ridge(-50.0, 150.0))
    assert (
        longer.ground.leg_height_ranges_m(compiled(longer).path_m)[:, 2].max() <= longer.scenario.transit_ceiling_agl_m
    )
    with pytest.raises(InfeasibleError, match=r"raise limits\.max_transit_height_agl_m"):
        compiled(make_site(ridge(-50.0, 250.0)))
    high = compiled(make_site(ridge(-50.0, 150.0), limits={"max_transit_height_agl_m": 200.0}))
    assert low.path_m[:, 2].max() < 121.0
    assert high.path_m[:, 2].max() >= 150.0 + 20.0
    assert high.max_height_above_home_m == pytest.approx(high.path_m[:, 2].max(), abs=0.01)


def test_over_a_gorge_the_ways_there_and_home_go_low_and_climb_to_the_route_where_it_is() -> None:
    def gorge(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return np.where(np.abs(east + 50.0) < 15.0, -100.0, 0.0) + 0.0 * north

    site = make_site(gorge)
    found = compiled(site, route((20, 50, 110), (80, 50, 110)))
    assert found.path_m[:, 2].max() == pytest.approx(110.0)
    path = found.path_m[: len(found.path_m) - 2]
    lowest, highest = path[path[:, 0] < 10.0][:, 2].min(), path[path[:, 0] < 10.0][:, 2].max()
    assert 20.0 <= lowest <= highest <= 50.0  # 150 m above the bottom of the gorge are allowed
    flat_path = compiled(make_site(flat), route((20, 50, 110), (80, 50, 110)))
    assert len(flat_path.path_m) < len(found.path_m)


def test_the_column_above_home_reaches_the_clearance() -> None:
    assert compiled(make_site(vehicle={"takeoff_height_m": 5.0})).path_m[0, 2] >= 20.0
    assert compiled(make_site(vehicle={"takeoff_height_m": 55.0})).path_m[0, 2] == pytest.approx(55.0)
    # Also where the planned route begins straight above home.
    site = make_site(vehicle={"takeoff_height_m": 5.0}, limits={"min_height_agl_m": 10.0, "transit_clearance_m": 30.0})
    found = compiled(site, route((*HOME, 15.0), (0, 50, 50)))
    assert found.path_m[0] == pytest.approx([*HOME, 31.0])
    assert found.path_m[1] == pytest.approx([*HOME, 15.0])


def test_a_band_below_the_transit_clearance_ends_the_way_there_straight_above_the_route() -> None:
    site = make_site(limits={"min_height_agl_m": 10.0, "max_height_agl_m": 30.0, "transit_clearance_m": 25.0})
    found = compiled(site, route((0, 50, 15), (300, 50, 15)))
    heights = found.path_m[:, 2]
    assert heights[0] >= 25.0
    first = found.first_waypoint_item - 1
    np.testing.assert_array_equal(found.path_m[first], [0, 50, 15])
    np.testing.assert_allclose(found.path_m[first - 1], [0, 50, 26])
    np.testing.assert_allclose(found.path_m[first + 2], [300, 50, 26])


# What is refused


def test_a_planned_leg_is_refused_with_its_number() -> None:
    with pytest.raises(
        InfeasibleError, match=r"the planned route: leg to waypoint 1: too low, 20\.0 m .*\(and 3 more\)"
    ):
        compiled(make_site(), route((0, 50, 80), (100, 50, 20), (100, 150, 80)))
    with pytest.raises(InfeasibleError, match="the planned route: leg to waypoint 2: too low"):
        compiled(make_site(ridge(150.0, 60.0)), route((0, 50, 80), (100, 50, 80), (200, 50, 80)))
    with pytest.raises(InfeasibleError, match="the planned route: waypoint 0: too high"):
        compiled(make_site(), route((0, 50, 130)))
    with pytest.raises(InfeasibleError, match="no waypoints"):
        compiled(make_site(), Route(np.empty((0, 3))))


def test_a_transit_is_refused_with_its_name() -> None:
    site = make_site(ridge(-50.0, 150.0), limits={"max_alt_amsl_m": ORIGIN.alt_amsl_m + 120.0})
    with pytest.raises(InfeasibleError, match=r"the outbound transit: leg to waypoint .*above sea-level limit"):
        compiled(site)
    u = (
        (-150.0, 0.0),
        (-50.0, 0.0),
        (-50.0, 150.0),
        (0.0, 150.0),
        (0.0, 0.0),
        (350.0, 0.0),
        (350.0, 250.0),
        (-150.0, 250.0),
    )
    site = make_site(fence=u)
    around = compiled(site, route((-20, 240, 80), (100, 200, 80), (10, 50, 80))).path_m
    assert site.fence.covers(shapely.LineString(around[:, :2]))
    with pytest.raises(InfeasibleError, match=r"the planned route: leg to waypoint .* outside the fence"):
        compiled(site, route((-20, 240, 80), (-20, 50, 80)))
    with pytest.raises(InfeasibleError, match=r"the outbound transit: .*no elevation data"):
        compiled(make_site(lambda e, n: np.where((e > -60) & (e < -40), np.nan, 0.0 * n)))


def test_a_home_below_the_lower_sea_level_limit_is_no_problem() -> None:
    site = make_site(limits={"min_alt_amsl_m": ORIGIN.alt_amsl_m + 75.0})
    assert compiled(site, route((0, 50, 80), (200, 50, 80))).waypoint_count == 2


def test_endurance() -> None:
    found = compiled(make_site())
    sure = {"power": PowerModel(uncertainty_fraction=0.0)}
    enough = make_site(vehicle={"endurance_s": 1.25 * found.flight_time_s + 1.0, **sure})
    assert compiled(enough).flight_time_s == found.flight_time_s
    with pytest.raises(
        InfeasibleError, match=r"the flight takes 220 s including transits, but vehicle\.endurance_s is 273\.669 s, and"
    ):
        compiled(make_site(vehicle={"endurance_s": 1.25 * found.flight_time_s - 1.0}))


def test_a_battery_that_the_wind_empties() -> None:
    calm = {"endurance_s": 400.0, "max_airspeed_m_s": 18.0}
    windy = make_site(vehicle=calm, wind=Wind(most_m_s=7.0))
    used, in_calm = compiled(windy).battery_used, compiled(make_site(vehicle=calm)).battery_used
    assert used is not None
    assert in_calm is not None
    assert used > 1.1 * in_calm
    short = make_site(vehicle={**calm, "endurance_s": 400.0 * used / 0.8 * 1.04}, wind=Wind(most_m_s=7.0))
    with pytest.raises(
        InfeasibleError,
        match=r"uses 77% of a battery in 7 m/s of wind; only .* is usable \(vehicle\.reserve_fraction = 0\.2",
    ):
        compiled(short)
    with pytest.raises(InfeasibleError, match=r"of a battery in 7 m/s of wind in gusts of 50 m/s; only"):
        compiled(with_scenario(short, wind=Wind(most_m_s=7.0, gust_m_s=50.0)))
    enough = make_site(vehicle={**calm, "endurance_s": 400.0 * used / 0.8 * 1.06}, wind=Wind(most_m_s=7.0))
    assert compiled(enough).battery_used == pytest.approx(0.8 / 1.06)
    assert compiled(make_site()).battery_used is None


def test_flight_time_by_hand() -> None:
    speeds = {"takeoff_height_m": 80.0, "max_climb_m_s": 4.0, "max_descent_m_s": 2.0}
    site = make_site(vehicle={**speeds, "acceleration_m_s2": math.inf})
    found = compiled(site, route((0, 50, 80), (200, 50, 80)))
    # 80 m up at 4 m/s, 100 + 200 + 300 m at 10 m/s, 68.5 m down at 2 m/s, a metre slower and slower, 10.5 m at 0.5 m/s.
    by_hand_s = 20.0 + 60.0 + 34.25 + math.log(4.0) / 1.5 + 21.0
    assert found.flight_time_s == pytest.approx(by_hand_s)
    # With 2.5 m/s2 and 1 m/s3: 6.5 s lost at both ends, what corners save is little; a climb of 80 m begins and ends slowly.
    slower = compiled(make_site(vehicle=speeds), route((0, 50, 80), (200, 50, 80)))
    assert by_hand_s + 8.0 < slower.flight_time_s < by_hand_s + 25.0


def test_no_place_on_earth_and_no_home() -> None:
    with pytest.raises(InputError, match="has no position on Earth; add"):
        compiled(make_site(on_earth=False))
    with pytest.raises(InputError, match=r"has no \[home\]"):
        compiled(make_site(home=None))


def test_too_many_items_for_the_autopilot() -> None:
    many = Route(np.array([[float(k % 300), 50.0, 80.0] for k in range(800)]))
    with pytest.raises(InfeasibleError, match="would reject this mission: the list: 805 items"):
        compile_mission(make_site(), many, autopilot="ardupilot")


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_both_autopilots_take_all_three_lists(autopilot: str) -> None:
    found = compile_mission(make_site(hills), sensing_route(make_site(hills)), autopilot=autopilot)  # type: ignore[arg-type]
    assert len(found.fence.polygons) == 1
    assert len(found.rally.points) == 1


# The autopilot's own return


def test_a_wall_steeper_than_the_samples_raises_the_transit() -> None:
    # The grid has a node every 10 m and the transit looks every 5 m, at places that miss the crest.
    site = make_site(ridge(-50.0, 80.0, 10.0), limits={"max_climb_angle_deg": 85.0})
    assert site.home_m is not None
    points = transit(site, site.home_m[:2], np.array([3.0, 50.0, 80.0]), ground_end_height_m=30.0)
    assert site.ground.leg_height_ranges_m(points)[:, 0].min() >= 20.0


# The files


def in_text(item: MissionItem) -> tuple[float, ...]:
    """The first four parameters as ``.waypoints`` has them: "any heading" is a 0 there."""
    return tuple(0.0 if math.isnan(value) else value for value in item.params)


def test_pymavlink_and_our_own_readers_read_the_same_items_back(tmp_path: Path) -> None:
    site = make_site(hills)
    found = compiled(site)
    text = export_text(found, "waypoints", autopilot="ardupilot", name="test")
    file = tmp_path / "mission.waypoints"
    file.write_text(text)
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(file)) == len(found.mission.items) + 1  # home is row 0
    for row, item in enumerate(found.mission.items, start=1):
        wp = loader.wp(row)
        assert (wp.command, wp.autocontinue) == (item.command, int(item.autocontinue))
        if item.has_position:
            assert wp.frame == int(item.frame)
            assert (wp.x, wp.y) == (pytest.approx(item.lat_deg, abs=1e-7), pytest.approx(item.lon_deg, abs=1e-7))
            assert wp.z == pytest.approx(item.alt_m, abs=1e-3)
        assert (wp.param1, wp.param2, wp.param3, wp.param4) == in_text(item)
    assert loader.wp(0).x == pytest.approx(site.frame.geodetic_from_enu(site.home_m)[0][0], abs=1e-7)  # type: ignore[union-attr,arg-type]
    ours = wpl.read(text).mission()
    for read, sent in zip(ours.items, found.mission.items, strict=True):
        assert (read.command, read.frame, read.params) == (sent.command, sent.frame, in_text(sent))
        # Text files carry whole units of 1e-7 degrees or finer, and fractions of a millimetre.
        assert (read.lat_deg, read.lon_deg) == pytest.approx((sent.lat_deg, sent.lon_deg), abs=1e-7)
        assert read.alt_m == pytest.approx(sent.alt_m, abs=1e-3)
    plan = plan_format.read(export_text(found, "plan", autopilot="px4", name="test"))
    assert all(same_item(a, b) for a, b in zip(plan.mission.items, found.mission.items, strict=True))
    assert plan.fence == found.fence
    assert plan.rally == found.rally


MAST = Obstacles(prisms=(tower(-60, 40, -50, 60, 90, name="mast"),), clearance_beside_m=12.0, clearance_above_m=7.0)


def test_the_ways_there_and_home_lead_over_an_obstacle() -> None:
    site = make_site(obstacles=MAST, limits={"max_climb_angle_deg": 80.0})
    # The mast stands between home and the area, higher than the route is flown.
    found = compiled(site, route((0, 50, 60), (300, 50, 60), (300, 150, 60), (0, 55, 60)))
    path = found.path_m
    for a, b in itertools.pairwise(path):
        for t in np.linspace(0.0, 1.0, 400):
            e, n, u = a + t * (b - a)
            beside = math.hypot(max(-60 - e, 0.0, e + 50), max(40 - n, 0.0, n - 60))
            assert beside >= 12.0 - 1e-6 or u >= 97.0 - 1e-6
    assert path[:, 2].max() >= 97.0
    assert found.return_advice.safe_return_height_m == pytest.approx(97.0, abs=0.03)
    assert found.return_advice.unsafe_waypoints == (0, 1, 2, 3)


def test_a_planned_leg_into_an_obstacle_is_refused_with_its_name() -> None:
    site = make_site(obstacles=Obstacles(prisms=(tower(140, 40, 160, 60, 90, name="mast"),)))
    with pytest.raises(InfeasibleError, match=r"the planned route: leg to waypoint 1: .* too close to obstacle 'mast'"):
        compiled(site, route((0, 50, 60), (300, 50, 60)))


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_the_heading_is_left_to_the_vehicle_whose_nose_follows_the_path(autopilot):
    """PX4 takes a heading of 0 as north and flies sideways; a camera that is wider than long would see less."""
    site = make_site(hills)
    mission = compile_mission(site, sensing_route(site), autopilot=autopilot).mission
    assert all(math.isnan(item.params[3]) for item in mission.items if item.has_position)
