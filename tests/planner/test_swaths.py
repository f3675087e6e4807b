import dataclasses
import math

import numpy as np
import pytest
import shapely

from tests.planner.sites import hills, make_site
from uavcover.planner.baselines.boustrophedon import (
    SwathLayout,
    begun_near_home,
    best_height_agl_m,
    boustrophedons,
    edge_angles_rad,
    fly_layout,
    long_side_angle_rad,
    plain_boustrophedon,
    regular_layout,
    width_across_m,
)
from uavcover.planner.search.optimizer_search import SwathEncoding
from uavcover.sensing.coverage_map import CoverageMap

L_SHAPE = ((0.0, 0.0), (300.0, 0.0), (300.0, 100.0), (100.0, 100.0), (100.0, 300.0), (0.0, 300.0))


def corners(route: np.ndarray) -> list[tuple[float, float]]:
    """Places where the map direction changes, and both ends."""
    en = route[:, :2]
    keep = [0]
    for k in range(1, len(en) - 1):
        a, b = en[k] - en[keep[-1]], en[k + 1] - en[k]
        if abs(a[0] * b[1] - a[1] * b[0]) > 1e-6 * np.hypot(*a) * np.hypot(*b):
            keep.append(k)
    return [(round(float(e), 6), round(float(n), 6)) for e, n in en[[*keep, len(en) - 1]]]


def layout(lines: int, *, start: int = 0, **changes: float) -> SwathLayout:
    regular = {"angle_rad": 0.0, "lines": lines, "height_agl_m": 80.0, "inset": 0.0, "tolerance_m": 10.0, **changes}
    return dataclasses.replace(regular_layout(**regular), start=start)  # type: ignore[arg-type]


def test_a_regular_layout_is_the_boustrophedon_with_half_a_gap_at_both_borders() -> None:
    route = fly_layout(make_site(), layout(4)).waypoints_m
    assert corners(route) == [(0, 25), (300, 25), (300, 75), (0, 75), (0, 125), (300, 125), (300, 175), (0, 175)]
    assert route[:, 2] == pytest.approx(80.0)


@pytest.mark.parametrize(
    ("start", "first", "last"),
    [(0, (0, 50), (0, 150)), (1, (300, 50), (300, 150)), (2, (0, 150), (0, 50)), (3, (300, 150), (300, 50))],
)
def test_start_bits(start: int, first: tuple[float, float], last: tuple[float, float]) -> None:
    found = corners(fly_layout(make_site(), layout(2, start=start)).waypoints_m)
    assert found[0] == first
    assert found[-1] == last
    assert len(found) == 4


def test_a_line_covers_the_whole_strip_of_an_l_shaped_area() -> None:
    found = corners(fly_layout(make_site(ring=L_SHAPE), layout(3)).waypoints_m)
    # Strips 0-100, 100-200, 200-300: the second only touches the wide part along its border, which belongs to it.
    assert found[:2] == [(0, 50), (300, 50)]
    assert found[-2:] == [(0, 250), (100, 250)]


def test_a_line_reaches_the_tip_of_a_triangle_inside_its_strip() -> None:
    site = make_site(ring=((0.0, 0.0), (300.0, 0.0), (0.0, 200.0)))
    found = corners(fly_layout(site, layout(2)).waypoints_m)
    assert found == [(0, 50), (300, 50), (150, 150), (0, 150)]  # at the lower border of its strip the area is widest


def test_a_concave_area_is_flown_across() -> None:
    u_shape = (
        (0.0, 0.0),
        (300.0, 0.0),
        (300.0, 200.0),
        (200.0, 200.0),
        (200.0, 50.0),
        (100.0, 50.0),
        (100.0, 200.0),
        (0.0, 200.0),
    )
    found = corners(fly_layout(make_site(ring=u_shape), layout(2)).waypoints_m)
    assert found == [(0, 50), (300, 50), (300, 150), (0, 150)]


def test_an_area_in_two_parts_has_no_line_where_nothing_lies() -> None:
    site = make_site(holes=(((-1.0, 60.0), (301.0, 60.0), (301.0, 140.0), (-1.0, 140.0)),))
    assert isinstance(site.area, shapely.MultiPolygon)
    found = corners(fly_layout(site, layout(5)).waypoints_m)
    assert found == [(0, 20), (300, 20), (300, 60), (0, 60), (0, 140), (300, 140), (300, 180), (0, 180)]


@pytest.mark.parametrize("inset", [0.0, 0.5, 1.0, 2.0, 50.0])
@pytest.mark.parametrize(
    "ring", [((0.0, 0.0), (300.0, 0.0), (300.0, 200.0), (0.0, 200.0)), ((0.0, 0.0), (300.0, 0.0), (0.0, 200.0))]
)
def test_insets_never_cross_the_middle(inset: float, ring: tuple[tuple[float, float], ...]) -> None:
    site = make_site(ring=ring)
    plain = np.array(corners(fly_layout(site, layout(4)).waypoints_m))
    inset_ends = fly_layout(site, layout(4, inset=inset)).waypoints_m
    for west, east in (sorted(plain[k : k + 2, 0]) for k in range(0, 8, 2)):
        north = plain[np.flatnonzero(plain[:, 0] == east)[0], 1] if west == 0 else 0
        on_line = inset_ends[np.abs(inset_ends[:, 1] - north) < 1e-6][:, 0]
        assert on_line.min() >= west - 1e-9
        assert on_line.max() <= east + 1e-9
        assert on_line.min() <= 0.5 * (west + east) <= on_line.max()


def test_lines_turn_with_the_angle() -> None:
    site = make_site()
    route = fly_layout(site, layout(3, angle_rad=math.pi / 2)).waypoints_m
    found = np.array(corners(route))
    assert sorted({round(e, 6) for e in found[:, 0]}) == [50, 150, 250]
    assert (found[:, 1].min(), found[:, 1].max()) == (0, 200)
    assert width_across_m(site, math.pi / 2) == pytest.approx(300.0)
    assert width_across_m(site, 0.0) == pytest.approx(200.0)


def test_the_long_side() -> None:
    c, s = math.cos(0.3), math.sin(0.3)
    ring = tuple((c * e - s * n, s * e + c * n) for e, n in ((0.0, 0.0), (300.0, 0.0), (300.0, 200.0), (0.0, 200.0)))
    assert math.sin(long_side_angle_rad(make_site(ring=ring).area) - 0.3) == pytest.approx(0.0, abs=1e-9)


# The encoding


def same_route(a: SwathLayout, b: SwathLayout) -> None:
    site = make_site(hills)
    np.testing.assert_allclose(fly_layout(site, a).waypoints_m, fly_layout(site, b).waypoints_m, atol=1e-6)


@pytest.mark.parametrize("start", [0, 1, 2, 3])
def test_zero_genes_are_the_centred_layout(start: int) -> None:
    centre = layout(4, angle_rad=0.2, inset=0.3, start=start)
    encoding = SwathEncoding(make_site(hills), centre=centre)
    found = encoding.layout(np.zeros_like(encoding.lower))
    assert found.start == start
    same_route(found, centre)
    np.testing.assert_array_equal(encoding.near(centre), 0.0)


@pytest.mark.parametrize(
    "wanted",
    [
        layout(5, angle_rad=0.9, inset=0.1, tolerance_m=15.0, height_agl_m=95.0),
        layout(3, angle_rad=-1.0, inset=0.8, start=3),
        layout(6, start=1),
        layout(4, angle_rad=2.5),
        layout(5, angle_rad=2.5, start=1),
        layout(4, angle_rad=-2.0, start=2),
    ],
)
def test_near_inverts_layout(wanted: SwathLayout) -> None:
    encoding = SwathEncoding(make_site(hills), centre=layout(4, angle_rad=0.2, inset=0.3, start=1))
    genes = encoding.near(wanted)
    assert (genes >= encoding.lower).all()
    assert (genes <= encoding.upper).all()
    same_route(encoding.layout(genes), wanted)


def test_genes_of_lines_that_a_layout_does_not_have_are_ignored() -> None:
    encoding = SwathEncoding(make_site(hills), centre=layout(4))
    genes = np.random.default_rng(3).uniform(-1.0, 1.0, encoding.lower.size)
    genes[1] = -1.0  # two lines: three gaps, two heights
    other = genes.copy()
    capacity = 6
    other[5 + 3 : 5 + capacity + 1] *= -1.0
    other[5 + capacity + 1 + 2 :] *= -1.0
    assert len(encoding.layout(genes).heights_agl_m) == 2
    np.testing.assert_array_equal(encoding.decode(genes).waypoints_m, encoding.decode(other).waypoints_m)
    other[5 + 2] += 0.1
    assert not np.array_equal(encoding.decode(genes).waypoints_m, encoding.decode(other).waypoints_m)


def test_every_vector_of_genes_is_a_layout_inside_the_band() -> None:
    site = make_site(hills, limits={"height_margin_m": 5.0})
    encoding = SwathEncoding(site, centre=layout(1))
    rng = np.random.default_rng(1)
    starts = set()
    for _ in range(100):
        found = encoding.layout(rng.uniform(encoding.lower, encoding.upper))
        assert 1 <= len(found.heights_agl_m) <= 3
        assert len(found.gaps) == len(found.heights_agl_m) + 1
        assert (found.heights_agl_m >= 45.0).all()
        assert (found.heights_agl_m <= 115.0).all()
        assert found.inset >= 0.0
        starts.add(found.start)
    assert starts == {0, 1, 2, 3}


# The baselines


def test_the_plain_boustrophedon_puts_strips_side_by_side() -> None:
    site = make_site()
    height = best_height_agl_m(site)
    assert height == pytest.approx(110.0)  # the band less the tolerance
    reach = 110.0 * math.tan(math.radians(35.0))  # 77.02 m
    found = plain_boustrophedon(site)
    assert len(found.heights_agl_m) == math.ceil(200.0 / (2.0 * reach)) == 2
    assert found.angle_rad == pytest.approx(0.0)
    assert corners(fly_layout(site, found).waypoints_m) == [(0, 50), (300, 50), (300, 150), (0, 150)]


def test_a_sensor_of_short_range_sees_widest_from_low_down() -> None:
    # Above 200 cos(35) = 163.8 m the range limits the strip, not the field of view.
    site = make_site(limits={"min_height_agl_m": 165.0, "max_height_agl_m": 195.0})
    assert best_height_agl_m(site) == pytest.approx(175.0)


def test_the_scan_starts_with_the_plain_one_and_stops_when_told() -> None:
    coverage = CoverageMap(make_site(), cell_size_m=20.0)
    stopped = boustrophedons(coverage, should_stop=lambda: True)
    assert [b.name for b in stopped] == ["boustrophedon"]
    everything = boustrophedons(coverage)
    assert {b.name for b in everything} == {"boustrophedon", "boustrophedon-tuned", "boustrophedon-return"}
    assert all(b.violation == 0.0 for b in everything)
    np.testing.assert_array_equal(everything[0].objectives, stopped[0].objectives)


def test_directions_of_edges_come_by_metres_of_border_and_parallel_ones_count_together() -> None:
    # 100 m and 160 m nearly along x, 125 m slanted, 112 m across.
    site = make_site(ring=((0.0, 0.0), (100.0, 0.0), (160.0, 110.0), (0.0, 112.0)))
    first, second, third = edge_angles_rad(site.area)
    assert math.tan(first) == pytest.approx(-2.0 / 160.0)
    assert math.tan(second) == pytest.approx(110.0 / 60.0)
    assert abs(third) == pytest.approx(math.pi / 2.0)
    hole = ((40.0, 40.0), (50.0, 50.0), (40.0, 50.0))
    holed = make_site(ring=((0.0, 0.0), (100.0, 0.0), (100.0, 80.0), (0.0, 80.0)), holes=(hole,)).area
    assert [abs(each) for each in edge_angles_rad(holed)] == pytest.approx([0.0, math.pi / 2.0, math.pi / 4.0])


@pytest.mark.parametrize("start", range(4))
@pytest.mark.parametrize("lines", [4, 6])
def test_lines_that_return_see_the_whole_area_and_end_beside_their_beginning(lines: int, start: int) -> None:
    site = make_site()
    east, north = 300.0, 200.0
    route = fly_layout(site, dataclasses.replace(layout(lines, start=start), returns=True)).waypoints_m
    apart_m = north / lines
    # Nothing lies farther from it than half the distance between lines, but the corners where a line meets the return line.
    positions = shapely.points(*np.meshgrid(np.linspace(0.0, east, 31), np.linspace(0.0, north, 41)))
    away_m = shapely.distance(shapely.LineString(route[:, :2]), positions)
    assert away_m.max() <= apart_m / math.sqrt(2.0) + 1e-6
    assert np.mean(away_m > 0.5 * apart_m + 1e-6) < 0.03
    assert np.hypot(*(route[-1] - route[0])[:2]) == pytest.approx(apart_m)
    plain = fly_layout(site, layout(lines, start=start)).waypoints_m
    assert np.hypot(*(plain[-1] - plain[0])[:2]) == pytest.approx((lines - 1) * apart_m)


@pytest.mark.parametrize("lines", [1, 2, 3, 5])
def test_few_lines_and_odd_numbers_do_not_return(lines: int) -> None:
    site = make_site()
    route = fly_layout(site, dataclasses.replace(layout(lines), returns=True)).waypoints_m
    assert np.array_equal(route, fly_layout(site, layout(lines)).waypoints_m)


@pytest.mark.parametrize("returns", [False, True])
@pytest.mark.parametrize("lines", [1, 3, 4])
@pytest.mark.parametrize("home", [(-100.0, -40.0), (400.0, -40.0), (-100.0, 260.0), (400.0, 260.0)])
def test_lines_begin_where_the_ways_from_and_to_home_are_shortest(
    home: tuple[float, float], lines: int, returns: bool
) -> None:
    site = make_site(home=home)

    def length_m(begun: SwathLayout) -> float:
        ends = fly_layout(site, begun).waypoints_m[[0, -1], :2]
        return float(np.hypot(*(ends - home).T).sum())

    wanted = dataclasses.replace(layout(lines, angle_rad=0.3), returns=returns)
    chosen = begun_near_home(site, wanted)
    assert length_m(chosen) == pytest.approx(min(length_m(dataclasses.replace(wanted, start=k)) for k in range(4)))
    assert (chosen.returns, chosen.angle_rad, len(chosen.gaps)) == (returns, 0.3, lines + 1)
