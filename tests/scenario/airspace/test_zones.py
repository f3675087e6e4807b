"""No-fly zones in the local frame, and ways around them."""

import numpy as np
import pytest
import shapely

from tests.naive.paths import shortest_length
from tests.naive.zones import enters
from tests.planner.sites import flat, make_site
from uavcover.model.limits import NoFly
from uavcover.scenario.airspace.zones import PathAround, ZoneCheck, around_circle, local_zones

EVERYWHERE = shapely.box(-1e5, -1e5, 1e5, 1e5)
SQUARE = ((100.0, 0.0), (200.0, 0.0), (200.0, 100.0), (100.0, 100.0))


def slope(east, north):
    return 0.1 * east + 0.05 * north


def zone_of(**keys):
    return local_zones([NoFly(name="x", **keys)], None, EVERYWHERE)[0]


def check_of(zone, *, height_margin_m=0.0, margins=False, ups=slope):
    site = make_site(ups, on_earth=False)
    return ZoneCheck((zone,), site.ground, None, height_margin_m=height_margin_m, margins=margins)


def breaches(check, *positions):
    return check.leg_breaches(np.array(positions, dtype=float))


def random_zone(rng):
    middle = rng.uniform(-60.0, 260.0, 2)
    if rng.random() < 0.4:
        keys = {"center_east_north_m": tuple(map(float, middle)), "radius_m": float(rng.uniform(5.0, 120.0))}
    else:
        count = int(rng.integers(3, 12))
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        reach = rng.uniform(10.0, 130.0, count)
        ring = middle + reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        if not shapely.Polygon(ring).is_valid:
            ring = np.asarray(shapely.Polygon(ring).convex_hull.exterior.coords)[:-1]
        keys = {"polygon_east_north_m": tuple((float(e), float(n)) for e, n in ring)}
    if rng.random() < 0.6:
        keys["floor_agl_m" if rng.random() < 0.5 else "floor_amsl_m"] = float(rng.uniform(0.0, 90.0))
    if rng.random() < 0.6:
        keys["ceiling_agl_m" if rng.random() < 0.5 else "ceiling_amsl_m"] = float(rng.uniform(100.0, 180.0))
    return zone_of(**keys, margin_m=float(rng.uniform(0.0, 20.0)))


@pytest.mark.parametrize("margins", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_no_leg_enters_unseen_and_none_is_refused_without_reason(seed, margins):
    rng = np.random.default_rng(seed)
    zone = random_zone(rng)
    check = check_of(zone, margins=margins, height_margin_m=5.0 if margins else 0.0)
    outer = check_of(zone, margins=True, height_margin_m=5.5) if margins else check
    kept = {"margin_m": zone.entry.margin_m, "height_margin_m": 5.0} if margins else {}
    for _ in range(25):
        p, q = rng.uniform((-100.0, -100.0, 20.0), (300.0, 300.0, 190.0), (2, 3))
        if rng.random() < 0.2:
            q[:2] = p[:2]
        truly = enters(zone, slope, p, q, alt_offset_m=0.0, samples=800, **kept)
        reported = bool(breaches(check, p, q))
        if truly:
            # Samples that are in it are proof; a plumb line is straight here, so nothing is near enough to doubt.
            assert reported, (zone, p, q)
        elif (
            reported
            and not (zone.entry.floor_agl_m and zone.entry.ceiling_amsl_m)
            and not (zone.entry.floor_amsl_m and zone.entry.ceiling_agl_m)
        ):
            # The corners of a grown outline are mitred, and samples miss what is short: a wider margin has to enter then.
            (breach,) = breaches(outer, p, q)
            wider = {
                "margin_m": 2.1 * kept.get("margin_m", 0.0) + 1.0,
                "height_margin_m": kept.get("height_margin_m", 0.0) + 0.5,
            }
            assert breach.depth_m < 1.0 or enters(zone, slope, p, q, alt_offset_m=0.0, samples=800, **wider)


def test_a_leg_across_says_where_it_is_deepest():
    (breach,) = breaches(check_of(zone_of(polygon_east_north_m=SQUARE)), (0, 50, 80), (300, 50, 80))
    assert (breach.leg, breach.zone) == (0, 0)
    assert breach.depth_m == pytest.approx(50.0, abs=0.1)
    assert breach.at == pytest.approx(0.5, abs=0.01)
    (breach,) = breaches(
        check_of(zone_of(center_east_north_m=(150.0, 50.0), radius_m=30.0)), (0, 60, 80), (300, 60, 80)
    )
    assert breach.depth_m == pytest.approx(20.0, abs=0.1)


@pytest.mark.parametrize(
    "line",
    [
        ((0, 100, 80), (300, 100, 80)),  # along an edge
        ((100, -50, 80), (100, 150, 80)),
        ((0, 200, 80), (100, 100, 80)),  # ends at a corner
        ((50, 150, 80), (150, 150, 80)),  # past it
        ((200, 100, 80), (300, 150, 80)),  # begins at a corner
        ((200, 100, 80), (200, 100, 20)),  # straight down at a corner
    ],
)
def test_touching_is_not_entering(line):
    zone = zone_of(polygon_east_north_m=SQUARE)
    assert breaches(check_of(zone), *line) == []


def test_through_two_opposite_corners_is_entering():
    assert breaches(check_of(zone_of(polygon_east_north_m=SQUARE)), (50, -50, 80), (250, 150, 80))


def test_a_sliver_between_two_samples_of_anybody_is_seen():
    sliver = ((150.0, -200.0), (150.02, -200.0), (150.02, 200.0), (150.0, 200.0))
    (breach,) = breaches(check_of(zone_of(polygon_east_north_m=sliver)), (-100, 13, 80), (300, 31, 80))
    assert breach.depth_m == pytest.approx(0.01, abs=2e-3)


@pytest.mark.parametrize(
    ("keys", "up_m", "enters_it"),
    [
        ({"floor_agl_m": 60.0}, 60.0, False),  # flat ground at 0
        ({"floor_agl_m": 60.0}, 60.01, True),
        ({"ceiling_agl_m": 60.0}, 60.0, False),
        ({"ceiling_agl_m": 60.0}, 59.99, True),
        ({"floor_amsl_m": 60.0, "ceiling_amsl_m": 70.0}, 65.0, True),
        ({"floor_amsl_m": 60.0, "ceiling_amsl_m": 70.0}, 71.0, False),
        ({"floor_agl_m": 60.0, "floor_amsl_m": 40.0}, 50.0, True),  # of two floors the lower one counts
        ({"ceiling_agl_m": 60.0, "ceiling_amsl_m": 90.0}, 80.0, True),  # of two ceilings the higher one
    ],
)
def test_floor_and_ceiling(keys, up_m, enters_it):
    check = check_of(zone_of(polygon_east_north_m=SQUARE, **keys), ups=flat)
    assert bool(breaches(check, (0, 50, up_m), (300, 50, up_m))) == enters_it


def test_a_climbing_leg_that_passes_under_the_floor_is_outside():
    check = check_of(zone_of(polygon_east_north_m=SQUARE, floor_agl_m=60.0), ups=flat)
    assert breaches(check, (0, 50, 20), (200, 50, 60)) == []
    assert breaches(check, (0, 50, 20), (200, 50, 61))


def test_height_margins_widen_floor_and_ceiling():
    zone = zone_of(polygon_east_north_m=SQUARE, floor_agl_m=60.0)
    level = {"ups": flat}
    assert breaches(check_of(zone, height_margin_m=5.0, **level), (0, 50, 56), (300, 50, 56))
    assert not breaches(check_of(zone, height_margin_m=5.0, **level), (0, 50, 55), (300, 50, 55))


def test_unknown_ground_is_no_way_out():
    check = check_of(zone_of(polygon_east_north_m=((5000.0, 0.0), (5100.0, 0.0), (5100.0, 100.0)), floor_agl_m=500.0))
    assert breaches(check, (4900, 20, 100), (5200, 20, 100))


def test_holes_are_outside():
    hole = ((130.0, 30.0), (170.0, 30.0), (170.0, 70.0), (130.0, 70.0))
    zone = zone_of(polygon_east_north_m=SQUARE)
    ring = type(zone)(zone.entry, "x", shapely.Polygon(SQUARE, [hole]))
    assert breaches(check_of(ring), (140, 50, 80), (160, 50, 80)) == []
    assert breaches(check_of(ring), (140, 50, 80), (250, 50, 80))


@pytest.mark.parametrize("radius", [0.5, 40.0, 18520.0])
def test_the_polygon_around_a_circle_holds_it(radius):
    polygon = around_circle(3.0, -4.0, radius)
    assert shapely.distance(polygon.exterior, shapely.Point(3.0, -4.0)) >= radius * (1.0 - 1e-12)
    assert polygon.area < 1.003 * np.pi * radius**2


def test_many_zones_at_once_are_as_one_at_a_time():
    """The index of many zones finds what each zone finds alone; one has more corners than are tried one by one."""
    rng = np.random.default_rng(4)
    zones = [random_zone(rng) for _ in range(12)]
    angles = np.linspace(0.0, 2.0 * np.pi, 300, endpoint=False)
    reach = 60.0 + 8.0 * np.sin(9.0 * angles)
    ring = np.column_stack([40.0 + reach * np.cos(angles), 160.0 + reach * np.sin(angles)])
    zones.append(zone_of(polygon_east_north_m=tuple(map(tuple, ring.tolist())), margin_m=4.0))
    site = make_site(slope, on_earth=False)
    checks = [ZoneCheck((zone,), site.ground, None, height_margin_m=5.0, margins=True) for zone in zones]
    route = rng.uniform([-100.0, -100.0, 0.0], [300.0, 300.0, 220.0], (60, 3))
    route[9] = np.nan
    route[20, :2] = route[19, :2]
    together = ZoneCheck(tuple(zones), site.ground, None, height_margin_m=5.0, margins=True)
    for many, each in (
        (together.leg_breaches(route), [check.leg_breaches(route) for check in checks]),
        (together.position_breaches(route), [check.position_breaches(route) for check in checks]),
    ):
        alone = [(b.leg, z, b.depth_m, b.at) for z, found in enumerate(each) for b in found]
        assert [(b.leg, b.zone) for b in many] == [(leg, z) for leg, z, *_ in sorted(alone)]
        assert np.allclose([(b.depth_m, b.at) for b in many], [one[2:] for one in sorted(alone)], atol=1e-9)
        assert len(many) > 20


def test_depth_in_a_zone_with_many_corners_is_the_distance_to_its_edge():
    angles = np.linspace(0.0, 2.0 * np.pi, 500, endpoint=False)
    zone = zone_of(polygon_east_north_m=tuple((50.0 * np.cos(a), 50.0 * np.sin(a)) for a in angles.tolist()))
    positions = np.array([[3.0, 4.0, 50.0], [30.0, 0.0, 50.0], [70.0, 0.0, 50.0]])
    found = check_of(zone, ups=flat).position_breaches(positions)
    assert [breach.leg for breach in found] == [0, 1]
    assert [breach.depth_m for breach in found] == pytest.approx([45.0, 20.0], abs=0.01)


def random_region(rng):
    outer = shapely.box(0, 0, 200, 200).difference(shapely.box(*rng.uniform((80, 120, 100, 200), (100, 160, 130, 220))))
    holes = [shapely.Point(rng.uniform(20, 180, 2)).buffer(rng.uniform(5, 35), quad_segs=2) for _ in range(5)]
    pieces = shapely.get_parts(outer.difference(shapely.union_all(holes)))
    return max(pieces, key=lambda part: part.area)


@pytest.mark.parametrize("seed", range(6))
def test_ways_are_inside_and_the_shortest(seed):
    rng = np.random.default_rng(seed)
    region = random_region(rng)
    paths = PathAround(region)
    for _ in range(4):
        a, b = (paths.inside(position) for position in rng.uniform(0, 200, (2, 2)))
        path = paths.between(a, b)
        np.testing.assert_array_equal(path[[0, -1]], [a, b])
        assert shapely.LineString(path).length == 0.0 or region.buffer(1e-6).covers(shapely.LineString(path))
        # Corners of ways are 2 cm inside.
        assert np.hypot(*np.diff(path, axis=0).T).sum() == pytest.approx(shortest_length(region, a, b), abs=0.5)


def test_there_is_no_way_to_another_piece():
    paths = PathAround(shapely.MultiPolygon([shapely.box(0, 0, 10, 10), shapely.box(20, 0, 30, 10)]))
    assert paths.between(np.array([5.0, 5.0]), np.array([25.0, 5.0])) is None
    assert paths.between(np.array([5.0, 5.0]), np.array([8.0, 5.0])).tolist() == [[5.0, 5.0], [8.0, 5.0]]


def test_places_outside_move_to_the_nearest_inside():
    paths = PathAround(shapely.box(0, 0, 10, 10))
    np.testing.assert_allclose(paths.inside(np.array([15.0, 4.0])), [9.98, 4.0])
    np.testing.assert_array_equal(paths.inside(np.array([5.0, 4.0])), [5.0, 4.0])


def test_nothing_is_in_an_empty_region():
    paths = PathAround(shapely.Polygon())
    assert paths.between(np.array([5.0, 5.0]), np.array([25.0, 5.0])) is None
    assert paths.inside(np.array([5.0, 5.0])).tolist() == [5.0, 5.0]


@pytest.mark.parametrize("seed", range(8))
def test_a_line_is_kept_wherever_it_is_inside(seed):
    """Every place of the line that is well inside is on the way; what is between such pieces is the shortest way."""
    rng = np.random.default_rng(seed)
    region = random_region(rng)
    paths = PathAround(region)
    for _ in range(4):
        a, b = (paths.inside(position) for position in rng.uniform(0, 200, (2, 2)))
        path = paths.along(a, b)
        np.testing.assert_array_equal(path[[0, -1]], [a, b])
        flown = shapely.LineString(path)
        assert region.buffer(1e-6).covers(flown)
        line = shapely.LineString([a, b])
        kept = line.intersection(region.buffer(-0.1))
        assert kept.is_empty or flown.buffer(0.05).covers(kept)
        longest = line.length + sum(2.0 * part.length for part in shapely.get_parts(region.boundary))
        assert flown.length <= longest


def test_a_zone_in_the_middle_of_a_line_does_not_move_its_ends():
    paths = PathAround(shapely.box(0, 0, 100, 700).difference(shapely.box(40, 300, 70, 340)))
    path = paths.along(np.array([50.0, 5.0]), np.array([50.0, 695.0]))
    np.testing.assert_allclose(path, [[50, 5], [50, 300], [40, 300], [40, 340], [50, 340], [50, 695]], atol=0.05)
    assert len(paths.between(np.array([50.0, 5.0]), np.array([50.0, 695.0]))) == 4
