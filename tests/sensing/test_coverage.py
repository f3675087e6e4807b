import dataclasses

import numpy as np
import pytest
from scipy.integrate import dblquad

from tests.planner.sites import hills, make_site
from uavcover.errors import ScenarioError, TerrainError
from uavcover.model.sensor import DiscSensor, FrameCamera, NadirCamera, SphereSensor
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import build_site
from uavcover.sensing.cells import make_cells
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.terrain.ground import grid_ground


def paper(name="paper-R2", **sensor):
    scenario = load_scenario(name)
    return build_site(dataclasses.replace(scenario, sensor=dataclasses.replace(scenario.sensor, **sensor)))


def random_nodes(site, rng, count=40):
    """Anywhere in the box, those under the ground drawn again."""
    nodes = np.empty((0, 3))
    while len(nodes) < count:
        drawn = rng.uniform([0, 0, -1], [10, 10, 1], (200, 3))
        nodes = np.vstack([nodes, drawn[drawn[:, 2] >= site.ground.heights_m(drawn[:, :2])]])
    return nodes[:count]


@pytest.mark.parametrize(
    ("name", "line_of_sight", "mean"),
    [
        ("paper-R2", "ray", 90.4), ("paper-r1", "ray", 44.5), ("paper-R2", "midpoint", 93.7),
        ("paper-r1", "midpoint", 45.5), ("paper-planar", None, 67.9),
    ],
)  # fmt: skip
def test_forty_random_nodes_see_what_the_reference_measured(name, line_of_sight, mean):
    site = paper(name, **({} if line_of_sight is None else {"line_of_sight": line_of_sight}))
    coverage = CoverageMap(site, cell_size_m=0.5)
    assert coverage.grid.count == 400
    rng = np.random.default_rng(1)

    def nodes():
        # Discs know no ground: there the nodes lie evenly over the plane.
        return rng.uniform([0, 0, -1], [10, 10, 1], (40, 3)) if name == "paper-planar" else random_nodes(site, rng)

    fractions = [coverage.fraction(coverage.observed(nodes())) for _ in range(30)]
    assert 100.0 * np.mean(fractions) == pytest.approx(mean, abs=1.5)


def test_weights_are_the_area_of_the_ground():
    site = paper()
    expected, _ = dblquad(
        lambda y, x: np.sqrt(1 + (np.sin(y) * np.sin(x)) ** 2 + (np.cos(y) * np.cos(x)) ** 2), 0, 10, 0, 10
    )
    for size, tolerance in ((0.5, 2e-3), (0.1, 1e-4)):
        assert make_cells(site, size).weight_m2.sum() == pytest.approx(expected, rel=tolerance)
    grid = make_cells(site, 0.5)
    assert grid.fraction(np.ones(400, dtype=bool)) == pytest.approx(1.0)
    assert grid.fraction(np.zeros(400, dtype=bool)) == 0.0
    half = np.arange(400) < 200
    assert grid.fraction(half) == pytest.approx(grid.weight_m2[:200].sum() / expected, rel=2e-3)


def test_cells_are_centres_on_the_ground_with_upright_unit_normals():
    grid = make_cells(paper(), 0.5)
    centre = grid.cells.centre_m
    np.testing.assert_allclose(centre[[0, 1, 20], :2], [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75]])
    np.testing.assert_allclose(centre[:, 2], np.sin(centre[:, 1]) * np.cos(centre[:, 0]))
    np.testing.assert_allclose(np.linalg.norm(grid.cells.normal, axis=1), 1.0)
    assert (grid.cells.normal[:, 2] > 0.5).all()
    assert not any(a.flags.writeable for a in (centre, grid.cells.normal, grid.cells.lattice, grid.weight_m2))


def grid_site(nodes, *, step=5.0, sensor=None, **limits):
    """A square of 40 m on ground of its own, in an otherwise plain scenario."""
    scenario = load_scenario("paper-R2")
    square = ((0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0))
    scenario = dataclasses.replace(
        scenario,
        area=dataclasses.replace(scenario.area, polygon_east_north_m=square, cell_size_m=2.0),
        sensor=sensor or SphereSensor(kind="sphere", range_m=30.0),
        limits=dataclasses.replace(
            scenario.limits, **{"min_height_agl_m": 10.0, "max_height_agl_m": 20.0, "min_alt_amsl_m": None,
            "max_alt_amsl_m": None, "fence_east_north_m": square, **limits},
        ),
    )  # fmt: skip
    ground = grid_ground(nodes, east0_m=-20, north0_m=-20, step_m=step, source="made", vertical_datum="local")
    return dataclasses.replace(build_site(scenario), ground=ground)


def test_a_quarter_turn_changes_nothing():
    nodes = np.random.default_rng(4).uniform(0, 25, (17, 17))
    turned_nodes = np.rot90(nodes)  # the rows go north: (e, n) goes to (40 - n, e) or the reverse
    route = np.random.default_rng(5).uniform([0, 0, 20], [40, 40, 45], (5, 3))
    # No centre of these cells lies on a line between nodes, where the slope is that of one side.
    fraction = CoverageMap(grid_site(nodes), cell_size_m=2.5)
    turned = CoverageMap(grid_site(turned_nodes), cell_size_m=2.5)
    # rot90 of rows by columns puts column c of row r into row (last - c): north' = 40 - east, east' = north.
    turned_route = np.column_stack([route[:, 1], 40.0 - route[:, 0], route[:, 2]])
    a, b = fraction.fraction(fraction.observed(route)), turned.fraction(turned.observed(turned_route))
    assert 0.1 < a < 0.95
    assert a == pytest.approx(b, abs=1e-9)
    assert fraction.grid.weight_m2.sum() == pytest.approx(turned.grid.weight_m2.sum())


def test_everything_of_the_paper_is_coverable_and_its_share_is_relative():
    coverage = CoverageMap(paper(), cell_size_m=0.5)
    assert coverage.coverable.all()
    observed = np.arange(400) % 3 == 0
    assert coverage.fraction_of_coverable(observed) == pytest.approx(coverage.fraction(observed))


def test_what_lies_too_deep_for_the_sea_level_limit_is_not_coverable():
    nodes = np.zeros((17, 17))
    nodes[:, 9:] = 100.0
    # Above the plateau at 100 m the band starts at 110 m.
    coverage = CoverageMap(grid_site(nodes, max_alt_amsl_m=60.0), cell_size_m=2.0)
    high = coverage.grid.cells.centre_m[:, 2] > 99.0
    assert high.any()
    assert not coverage.coverable[high].any()
    assert coverage.coverable[coverage.grid.cells.centre_m[:, 2] == 0.0].all()
    assert coverage.fraction_of_coverable(coverage.coverable) == 1.0
    nothing = CoverageMap(grid_site(nodes, max_alt_amsl_m=5.0), cell_size_m=2.0)
    assert not nothing.coverable.any()
    assert nothing.fraction_of_coverable(np.ones(nothing.grid.count, dtype=bool)) == 0.0


def test_what_no_place_inside_the_fence_reaches_is_not_coverable():
    fence = ((0.0, 0.0), (10.0, 0.0), (10.0, 40.0), (0.0, 40.0))
    coverage = CoverageMap(
        grid_site(np.zeros((17, 17)), sensor=DiscSensor(kind="disc", radius_m=5.0), fence_east_north_m=fence),
        cell_size_m=2.0,
    )
    east = coverage.grid.cells.centre_m[:, 0]
    assert coverage.coverable[east <= 10.0].all()
    assert not coverage.coverable[east > 15.0].any()


def test_sensing_along_the_path_looks_between_the_waypoints_too():
    route = np.array([[5.0, 20.0, 15.0], [35.0, 20.0, 15.0]])
    disc = DiscSensor(kind="disc", radius_m=4.0, sensing="at-waypoints", sample_spacing_m=3.0)
    ends = CoverageMap(grid_site(np.zeros((17, 17)), sensor=disc), cell_size_m=2.0)
    path = CoverageMap(
        grid_site(np.zeros((17, 17)), sensor=dataclasses.replace(disc, sensing="along-path")), cell_size_m=2.0
    )
    assert ends.observations(route).positions_m.tolist() == route.tolist()
    assert len(path.observations(route)) == 11
    assert path.fraction(path.observed(route)) > 2 * ends.fraction(ends.observed(route))
    first = path.first_observed(path.observations(route))
    assert (first >= 0).tolist() == path.observed(route).tolist()
    assert first.max() <= 10


def test_areas_that_cannot_be_cut_or_have_no_ground():
    site = grid_site(np.zeros((17, 17)))
    with pytest.raises(ScenarioError, match=r"^area\.cell_size_m: 0\.001 m divides 40 x 40 m into 1,600,000,000 cells"):
        make_cells(site, 0.001)
    with pytest.raises(
        ScenarioError, match=r"^area.cell_size_m: no 90 m cell is centred in the area; use smaller cells"
    ):
        make_cells(site, 90.0)
    nodes = np.zeros((17, 17))
    nodes[8, 8] = np.nan
    with pytest.raises(
        TerrainError, match=r"^area: there is no elevation data in 6.2 % of its cells, first at 1\d m east, 1\d m north"
    ):
        make_cells(grid_site(nodes), 2.0)
    with pytest.raises(TerrainError, match="extends beyond the data"):
        make_cells(grid_site(np.zeros((5, 5))), 2.0)


@pytest.mark.parametrize(
    ("sensor", "height", "reach"),
    [
        (SphereSensor(kind="sphere", range_m=5.0), 3.0, 4.0),
        (SphereSensor(kind="sphere", range_m=5.0), 6.0, 0.0),
        (DiscSensor(kind="disc", radius_m=5.0), 3.0, 5.0),
        (NadirCamera(kind="nadir-camera", fov_deg=90.0, range_m=99.0), 3.0, 3.0),
        (NadirCamera(kind="nadir-camera", fov_deg=170.0, range_m=5.0), 3.0, 4.0),
        # Regression: the incidence limit was left out.
        (NadirCamera(kind="nadir-camera", fov_deg=170.0, range_m=99.0, max_incidence_deg=45.0), 3.0, 3.0),
    ],
)
def test_reach_on_flat_ground(sensor, height, reach):
    assert sensor.half_width_m(height) == pytest.approx(reach)


@pytest.mark.parametrize("count", [0, 1, 2, 63, 64, 65, 1000])
def test_observations_spread_out_are_the_same_ones_and_the_first_ones_are_far_apart(count):
    numbers = np.arange(count, dtype=float)
    path = LevelObservations(np.outer(numbers, [1.0, 2.0, 3.0]), np.outer(numbers, [4.0, 5.0]))
    other = path.spread_out()
    order = other.positions_m[:, 0].astype(int)
    assert sorted(order.tolist()) == list(range(count))
    assert np.array_equal(other.positions_m, path.positions_m[order])
    assert np.array_equal(other.headings, path.headings[order])
    assert (np.diff(np.sort(order[: max(1, count // 32)])) >= 32).all()


@pytest.mark.parametrize("trigger", [{}, {"trigger_distance_m": 35.0}], ids=["all along", "pictures"])
def test_what_is_seen_does_not_depend_on_the_order_of_observations(trigger):
    sensor = FrameCamera(kind="frame-camera", fov_across_deg=60.0, fov_along_deg=40.0, range_m=200.0, **trigger)
    coverage = CoverageMap(make_site(hills, sensor=sensor), cell_size_m=5.0)
    ground = coverage.site.ground.heights_m(np.array([[0.0, 40.0], [300.0, 60.0], [290.0, 150.0], [10.0, 140.0]]))
    route = np.column_stack([[0.0, 300.0, 290.0, 10.0], [40.0, 60.0, 150.0, 140.0], ground + 75.0])
    in_order = coverage.first_observed(coverage.flown_observations(route)) >= 0
    assert 0 < in_order.sum() < coverage.grid.count
    assert coverage.observed(route).tolist() == in_order.tolist()
