import itertools

import numpy as np
import pytest

from tests.planner.sites import CAMERA, flat, hills, make_site
from uavcover.errors import InfeasibleError
from uavcover.missions.leg_checks import find_problems
from uavcover.missions.mission_compiler import compile_mission
from uavcover.model.sensor import FrameCamera, SphereSensor
from uavcover.planner.gap_route import MissingCells, plan_gap_route
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.sensing.sensors import inside_every_heading


def missing_in(coverage: CoverageMap, *boxes: tuple[float, float, float, float]) -> np.ndarray:
    """Cells in boxes of west, south, east, north."""
    east, north = coverage.grid.cells.centre_m[:, :2].T
    return np.logical_or.reduce([(w <= east) & (east <= e) & (s <= north) & (north <= n) for w, s, e, n in boxes])


def repair(site: Site, coverage: CoverageMap, missing: np.ndarray, **options):
    assert site.home_m is not None
    return plan_gap_route(coverage, missing, start_m=site.home_m, end_m=site.home_m, **options)


def path_m(site: Site, route: np.ndarray) -> float:
    assert site.home_m is not None
    path = np.vstack([site.home_m[:2], route[:, :2], site.home_m[:2]])
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@pytest.mark.parametrize("ups", [flat, hills])
def test_every_missing_cell_is_seen_from_a_route_that_keeps_the_limits(ups) -> None:
    site = make_site(ups)
    coverage = CoverageMap(site, cell_size_m=5.0)
    missing = missing_in(coverage, (0, 80, 300, 130), (240, 0, 300, 30), (20, 180, 60, 200))
    result = repair(site, coverage, missing)
    route = result.route.waypoints_m
    assert not (missing & ~coverage.observed(route)).any()
    assert (
        result.observed_m2 == pytest.approx(result.wanted_m2) == pytest.approx(coverage.grid.weight_m2[missing].sum())
    )
    assert find_problems(site, route, lowest_agl_m=40.0, highest_agl_m=120.0) == []
    assert compile_mission(site, result.route, autopilot="ardupilot").waypoint_count == len(route)


def test_a_small_gap_beside_home_takes_one_waypoint_and_no_detour() -> None:
    site = make_site(flat, home=(20.0, 100.0))
    coverage = CoverageMap(site, cell_size_m=5.0)
    result = repair(site, coverage, missing_in(coverage, (0, 80, 40, 120)))
    assert len(result.route) == 1
    assert path_m(site, result.route.waypoints_m) < 60.0


def test_the_way_is_near_the_shortest_there_can_be() -> None:
    # Four single cells far apart: at best the tour touches the footprint's edge around each, no better order exists.
    site = make_site(flat, ring=((0, 0), (600, 0), (600, 400), (0, 400)), home=(300.0, 200.0))
    coverage = CoverageMap(site, cell_size_m=10.0)
    corners = [(5.0, 5.0), (595.0, 5.0), (595.0, 395.0), (5.0, 395.0)]
    missing = missing_in(coverage, *[(e - 1, n - 1, e + 1, n + 1) for e, n in corners])
    assert missing.sum() == 4
    result = repair(site, coverage, missing)
    home = np.array([300.0, 200.0])
    through = min(
        sum(np.linalg.norm(np.diff(np.array([home, *order, home]), axis=0), axis=1))
        for order in itertools.permutations(np.array(corners))
    )
    reach = 120.0 * np.tan(np.radians(35.0))
    # The tour through the cells themselves is longer; cutting each corner saves at most twice the reach.
    assert through - 2 * 4 * reach <= path_m(site, result.route.waypoints_m) <= through - 3 * reach


def test_enough_is_enough() -> None:
    site = make_site(flat, ring=((0, 0), (800, 0), (800, 100), (0, 100)), home=(-20.0, 50.0))
    coverage = CoverageMap(site, cell_size_m=10.0)
    missing = missing_in(coverage, (0, 0, 100, 100), (700, 40, 710, 50))
    everything = repair(site, coverage, missing)
    most = repair(site, coverage, missing, needed_m2=0.95 * everything.wanted_m2)
    assert everything.observed_m2 == everything.wanted_m2
    assert 0.95 * everything.wanted_m2 <= most.observed_m2 < everything.wanted_m2
    assert path_m(site, most.route.waypoints_m) < 0.4 * path_m(site, everything.route.waypoints_m)


@pytest.mark.parametrize(("seed", "fraction"), [(6, 0.9), (11, 0.9), (17, 0.6), (29, 0.9), (32, 0.6), (33, 0.75)])
def test_what_is_asked_for_is_seen_though_corners_that_are_left_out_change_the_order(
    seed: int, fraction: float
) -> None:
    site = make_site(hills, ring=((0, 0), (1000, 0), (1000, 900), (0, 900)), home=(-20.0, -20.0))
    coverage = CoverageMap(site, cell_size_m=20.0)
    rng = np.random.default_rng(seed)
    west, south = rng.uniform(0.0, 960.0, 20), rng.uniform(0.0, 860.0, 20)
    boxes = zip(west, south, west + rng.uniform(20.0, 60.0, 20), south + rng.uniform(20.0, 60.0, 20), strict=True)
    missing = missing_in(coverage, *boxes) & coverage.coverable
    needed_m2 = fraction * coverage.grid.weight_m2[missing].sum()
    result = repair(site, coverage, missing, needed_m2=needed_m2)
    observed = coverage.observed(result.route.waypoints_m) & missing
    assert coverage.grid.weight_m2[observed].sum() == pytest.approx(result.observed_m2)
    assert result.observed_m2 >= needed_m2


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_tilted_camera_sees_what_the_route_says_as_it_is_flown(autopilot: str) -> None:
    """Its nose does not come round on short legs, by which places were looked at from a side of one's choice."""
    camera = FrameCamera(
        kind="frame-camera", fov_across_deg=50.0, fov_along_deg=38.0, range_m=250.0, pitch_deg=-50.0, mount="stabilised",
        max_incidence_deg=82.0,
    )  # fmt: skip
    site = make_site(hills, sensor=camera, vehicle={"autopilot": autopilot})
    coverage = CoverageMap(site, cell_size_m=5.0)
    missing = missing_in(coverage, (0, 80, 60, 110), (240, 0, 300, 30), (20, 180, 60, 200), (200, 180, 220, 200))
    result = repair(site, coverage, missing)
    observed = coverage.observed(result.route.waypoints_m)
    assert result.observed_m2 > 0.8 * result.wanted_m2
    assert coverage.grid.weight_m2[observed & missing].sum() >= result.observed_m2 - 1e-6


def test_sensors_that_look_from_waypoints() -> None:
    site = make_site(hills, sensor=SphereSensor(kind="sphere", range_m=110.0))
    coverage = CoverageMap(site, cell_size_m=10.0)
    missing = missing_in(coverage, (0, 0, 300, 60)) & coverage.coverable
    result = repair(site, coverage, missing)
    assert not (missing & ~coverage.observed(result.route.waypoints_m)).any()


@pytest.mark.parametrize("sensor", [CAMERA, SphereSensor(kind="sphere", range_m=110.0)], ids=["camera", "sphere"])
def test_nothing_to_close_and_nothing_that_can_be_closed(sensor) -> None:
    fence = ((-150.0, -50.0), (350.0, -50.0), (350.0, 60.0), (-150.0, 60.0))
    site = make_site(flat, fence=fence, sensor=sensor)
    coverage = CoverageMap(site, cell_size_m=10.0)
    with pytest.raises(InfeasibleError, match="no gaps"):
        repair(site, coverage, np.zeros(coverage.grid.count, dtype=bool))
    with pytest.raises(InfeasibleError, match="no allowed position can observe any"):
        repair(site, coverage, missing_in(coverage, (100, 180, 120, 200)))
    assert lay_over_terrain(site, np.empty((0, 2)), np.empty(0), tolerance_m=10.0).shape == (0, 3)


def test_the_same_every_time_and_nothing_of_the_caller_is_changed() -> None:
    site = make_site(hills)
    coverage = CoverageMap(site, cell_size_m=10.0)
    missing = missing_in(coverage, (0, 80, 300, 130))
    before = missing.copy()
    first, second = repair(site, coverage, missing), repair(site, coverage, missing)
    np.testing.assert_array_equal(first.route.waypoints_m, second.route.waypoints_m)
    np.testing.assert_array_equal(missing, before)


def test_missing_cells_see_what_the_whole_map_sees() -> None:
    site = make_site(hills)
    coverage = CoverageMap(site, cell_size_m=10.0)
    missing = missing_in(coverage, (50, 60, 220, 140))
    part = MissingCells.of(coverage, missing)
    positions = np.array([[100.0, 100.0, 90.0], [180.0, 60.0, 85.0]])
    observations = LevelObservations.towards_north(positions)
    np.testing.assert_array_equal(
        part.observed_by(observations, coverage.sight),
        coverage.observed_by(observations)[missing],
    )
    np.testing.assert_array_equal(part.weight_m2, coverage.grid.weight_m2[missing])


def test_where_there_is_no_time_the_first_route_is_given_that_keeps_the_limits() -> None:
    site = make_site(hills, ring=((0, 0), (600, 0), (600, 400), (0, 400)))
    coverage = CoverageMap(site, cell_size_m=10.0)
    missing = missing_in(coverage, (0, 0, 80, 80), (500, 300, 600, 400), (250, 150, 400, 200))
    required = []

    def is_over() -> bool:
        required.append(True)
        return True

    hurried = repair(site, coverage, missing, is_over=is_over)
    assert len(required) <= 3
    assert find_problems(site, hurried.route.waypoints_m, lowest_agl_m=40.0, highest_agl_m=120.0) == []
    assert hurried.observed_m2 > 0.5 * hurried.wanted_m2
    patient = repair(site, coverage, missing)
    assert path_m(site, patient.route.waypoints_m) < path_m(site, hurried.route.waypoints_m)


def test_a_route_that_sees_too_little_to_be_of_use_is_none() -> None:
    site = make_site(flat)
    coverage = CoverageMap(site, cell_size_m=5.0)
    missing = missing_in(coverage, (0, 80, 300, 130))
    all_m2 = repair(site, coverage, missing).observed_m2
    assert repair(site, coverage, missing, useful_m2=all_m2 - 1.0).observed_m2 == all_m2
    with pytest.raises(InfeasibleError, match="cannot close the gaps"):
        repair(site, coverage, missing, useful_m2=all_m2 + 1.0)


def test_what_a_frame_camera_sees_for_every_heading_is_the_cone_inside_its_picture() -> None:
    def camera(pitch_deg: float) -> FrameCamera:
        return FrameCamera(
            kind="frame-camera", fov_across_deg=60.0, fov_along_deg=40.0, range_m=250.0, mount="stabilised",
            pitch_deg=pitch_deg,
        )  # fmt: skip

    sight = camera(-90.0).sight
    (cone,) = inside_every_heading(sight)
    assert cone.tan_half_fov == sight.tan_half_along < sight.tan_half_fov
    assert inside_every_heading(camera(-50.0).sight) == []
    assert inside_every_heading(cone) == []
