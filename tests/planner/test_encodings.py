import numpy as np
import pytest

from tests.planner.sites import ORIGIN, hills, make_site
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.sensor import SphereSensor
from uavcover.planner.search.optimizer_search import WaypointEncoding
from uavcover.planner.terrain_following import allowed_band_m, finite_heights, lay_over_terrain
from uavcover.scenario.site import Site

SPHERE = SphereSensor(kind="sphere", range_m=150.0)
AT_ORIGIN = np.zeros(3)


def site_for_waypoints(**limits: object) -> Site:
    return make_site(hills, sensor=SPHERE, limits={"applies_to": "waypoints", **limits})


def encoding(site: Site, capacity: int = 6, order: str = "nearest-neighbour") -> WaypointEncoding:
    return WaypointEncoding(site, capacity=capacity, order=order, reference_m=AT_ORIGIN)  # type: ignore[arg-type]


def genes(*nodes: tuple[float, float, float, float]) -> np.ndarray:
    return np.array(nodes).ravel()


def test_bounds_are_the_area_and_unit_intervals() -> None:
    found = encoding(site_for_waypoints(), capacity=2)
    np.testing.assert_array_equal(found.lower, [0, 0, 0, 0] * 2)
    np.testing.assert_array_equal(found.upper, [300, 200, 1, 1] * 2)


def test_every_node_is_inside_the_allowed_band() -> None:
    # The sea-level limits cut the band of 40..120 m above ground on both sides.
    site = site_for_waypoints(
        height_margin_m=3.0, min_alt_amsl_m=ORIGIN.alt_amsl_m + 45.0, max_alt_amsl_m=ORIGIN.alt_amsl_m + 110.0
    )
    found = encoding(site)
    rng = np.random.default_rng(4)
    for _ in range(50):
        points = found.decode(rng.uniform(found.lower, found.upper)).waypoints_m
        heights = points[:, 2] - site.ground.heights_m(points[:, :2])
        assert (heights >= 43.0 - 1e-9).all()
        assert (heights <= 117.0 + 1e-9).all()
        alts = site.alts_amsl_m(points)
        assert (alts >= ORIGIN.alt_amsl_m + 45.0 - 1e-6).all()
        assert (alts <= ORIGIN.alt_amsl_m + 110.0 + 1e-6).all()
        assert measure_violations(site, points, margin_m=3.0).total == 0.0


def test_a_band_that_the_sea_level_limit_closes_is_a_violation_of_known_size() -> None:
    site = site_for_waypoints(max_alt_amsl_m=ORIGIN.alt_amsl_m + 30.0)
    low, high = allowed_band_m(site, np.array([[60.0, 0.0]]))
    ground = site.ground.heights_m([60.0, 0.0])[0]
    assert low[0] == pytest.approx(ground + 40.0)
    assert high[0] == pytest.approx(30.0, abs=1e-3)
    points = encoding(site, capacity=1).decode(genes((60.0, 0.0, 1.0, 1.0))).waypoints_m
    assert measure_violations(site, points, margin_m=0.0).total == pytest.approx(ground + 40.0 - 30.0, abs=1e-3)


def test_activation_above_one_half() -> None:
    found = encoding(site_for_waypoints(), capacity=3)
    points = found.decode(genes((10, 10, 0, 0.51), (50, 50, 0, 0.5), (90, 20, 0, 0.9))).waypoints_m
    np.testing.assert_array_equal(points[:, :2], [[10, 10], [90, 20]])


def test_when_none_is_active_the_largest_gene_is() -> None:
    found = encoding(site_for_waypoints(), capacity=3)
    points = found.decode(genes((10, 10, 0, 0.1), (50, 50, 0, 0.4), (90, 20, 0, 0.3))).waypoints_m
    np.testing.assert_array_equal(points[:, :2], [[50, 50]])


def test_genes_of_sleeping_nodes_are_ignored_and_the_genes_are_not_changed() -> None:
    found = encoding(site_for_waypoints(), capacity=2)
    one, other = genes((10, 10, 0.2, 0.9), (50, 50, 0.1, 0.2)), genes((10, 10, 0.2, 0.9), (77, 3, 0.9, 0.4))
    before = one.copy()
    np.testing.assert_array_equal(found.decode(one).waypoints_m, found.decode(other).waypoints_m)
    np.testing.assert_array_equal(one, before)


ZIGZAG = genes((200, 0, 0, 1), (30, 0, 0, 1), (110, 0, 0, 1), (60, 0, 0, 1), (5, 150, 0, 1))


def test_the_nearest_neighbour_from_the_origin() -> None:
    site = make_site(sensor=SPHERE, limits={"applies_to": "waypoints"})
    points = encoding(site, capacity=5).decode(ZIGZAG).waypoints_m
    np.testing.assert_array_equal(points[:, 0], [30, 60, 110, 200, 5])


def test_improved_is_no_longer_and_starts_at_the_same_node() -> None:
    site = site_for_waypoints()
    plain, improved = encoding(site, 12), encoding(site, 12, "improved")
    rng = np.random.default_rng(8)
    shorter = 0
    for _ in range(20):
        vector = rng.uniform(plain.lower, plain.upper)
        a, b = plain.decode(vector), improved.decode(vector)
        np.testing.assert_array_equal(a.waypoints_m[0], b.waypoints_m[0])
        assert sorted(map(tuple, a.waypoints_m)) == sorted(map(tuple, b.waypoints_m))
        assert b.length_m <= a.length_m + 1e-9
        shorter += b.length_m < a.length_m - 1e-9
    assert shorter > 0


def test_where_limits_apply_to_legs_the_legs_follow_the_terrain() -> None:
    site = make_site(hills, sensor=SPHERE)
    points = encoding(site, capacity=2).decode(genes((10, 10, 0.1, 1), (290, 190, 0.1, 1))).waypoints_m
    assert len(points) > 2
    assert measure_violations(site, points, margin_m=0.0).total == 0.0
    np.testing.assert_array_equal(points[[0, -1], :2], [[10, 10], [290, 190]])


def test_a_node_without_elevation_data_is_finite_and_a_violation() -> None:
    def hole(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return np.where((east > 100) & (east < 200), np.nan, 0.0 * north)

    for applies_to in ("waypoints", "legs"):
        site = make_site(hole, sensor=SPHERE, limits={"applies_to": applies_to})
        points = encoding(site, capacity=2).decode(genes((50, 50, 0, 1), (150, 50, 0, 1))).waypoints_m
        assert np.isfinite(points).all()
        assert measure_violations(site, points, margin_m=0.0).no_data_legs >= 1
        assert np.isfinite(measure_violations(site, points, margin_m=0.0).total)


def test_finite_heights() -> None:
    points = np.array([[0.0, 0, np.nan], [1, 0, 2], [2, 0, np.nan], [3, 0, 6]])
    np.testing.assert_array_equal(finite_heights(points)[:, 2], [2, 2, 4, 6])
    assert np.isnan(points[0, 2])
    np.testing.assert_array_equal(finite_heights(points[:1])[:, 2], [0])
    assert finite_heights(points[1:2])[0, 2] == 2


def test_laying_over_terrain_keeps_band_and_climb() -> None:
    site = make_site(hills, limits={"max_climb_angle_deg": 20.0, "height_margin_m": 2.0})
    points = lay_over_terrain(site, np.array([[0.0, 30.0], [300.0, 60.0]]), np.array([80.0, 80.0]), tolerance_m=10.0)
    assert measure_violations(site, points, margin_m=2.0).total == 0.0
    loose = lay_over_terrain(site, np.array([[0.0, 30.0], [300.0, 60.0]]), np.array([80.0, 80.0]), tolerance_m=30.0)
    assert len(loose) < len(points)
